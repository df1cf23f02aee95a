"""Waveform files, VCD or FST: their kinds, their modules and signals, and their estimated sizes."""

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from splatcore.sim.rtl.verilator import has_headers
from splatcore.spec.error import InputError

KINDS = ("vcd", "fst")
FST_HEADERS = ("zlib.h", "lz4.h")

LEVELS, DEEPEST = 4, 99
"""Recorded levels of modules: of the whole machine, from the module around it down to the stages;
and of a module named by --scope."""

HIERARCHY = 6  # type of FST's block of names, compressed by LZ4
SCOPE, UPSCOPE = 254, 255  # its entries that are not signals
LENGTH = 8  # bytes of a block's length
MATCH_MIN, MORE = 4, 15  # LZ4: bytes of the shortest match; a length continued in more bytes


def check_kind(path: Path) -> str:
    """Kind of waveforms by a file's suffix: "vcd" or "fst".

    Raises InputError for another suffix, and for FST if its C headers are not installed.
    """
    kind = path.suffix.lower().removeprefix(".") or KINDS[0]
    if kind not in KINDS:
        raise InputError(f"--waves {path}: must end in .vcd or .fst")
    if kind == "fst" and not has_headers(*FST_HEADERS):
        raise InputError(
            f"--waves {path}: FST needs {' and '.join(FST_HEADERS)} when the simulation is "
            "compiled (Debian: zlib1g-dev and liblz4-dev); VCD needs neither"
        )
    return kind


@dataclass(frozen=True)
class Signal:
    """A signal. scope: path of its module, from TOP on; code: equal for all names of one net."""

    scope: str
    name: str
    width: int
    code: str


def signals(path: Path) -> Iterator[Signal]:
    """Signals of a waveform file in its order; a FST if its suffix says so, else a VCD."""
    return _of_fst(path.read_bytes()) if path.suffix == ".fst" else _of_vcd(path)


def _of_vcd(path: Path) -> Iterator[Signal]:
    scopes = []
    with open(path) as file:
        for line in file:
            words = line.split()
            if words[:1] == ["$scope"]:
                scopes.append(words[2])
            elif words[:1] == ["$upscope"]:
                scopes.pop()
            elif words[:1] == ["$var"]:
                yield Signal(".".join(scopes), words[4], int(words[2]), words[3])
            elif words[:1] == ["$enddefinitions"]:
                return


def _of_fst(data: bytes) -> Iterator[Signal]:
    """Signals of a FST as written by Verilator; the format is GTKWave's (fstapi)."""
    names, at, scopes, nets = _hierarchy(data), 0, [], 0

    def text() -> str:
        nonlocal at
        begin, at = at, names.index(0, at) + 1
        return names[begin : at - 1].decode()

    def number() -> int:
        nonlocal at
        value, shift = 0, 0
        while True:
            byte, at = names[at], at + 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(names):
        kind, at = names[at], at + 1
        if kind == SCOPE:
            at += 1
            scopes.append(text())
            text()
        elif kind == UPSCOPE:
            scopes.pop()
        else:
            at += 1
            name, width, net = text(), number(), number()
            nets += not net
            yield Signal(".".join(scopes), name.split()[0], width, str(net or nets))


def _hierarchy(data: bytes) -> bytes:
    """Unpacked hierarchy block of a FST."""
    at = 0
    while at < len(data):
        length = int.from_bytes(data[at + 1 : at + 1 + LENGTH])
        if data[at] == HIERARCHY:
            return _unpacked(data[at + 1 + 2 * LENGTH : at + 1 + length])
        at += 1 + length
    raise InputError("waveforms: the file has no names")


def _unpacked(data: bytes) -> bytes:
    """Decompress an LZ4 block."""
    out, at = bytearray(), 0

    def length(count: int) -> int:
        nonlocal at
        if count == MORE:
            while True:
                byte, at = data[at], at + 1
                count += byte
                if byte < 255:
                    break
        return count

    while at < len(data):
        token, at = data[at], at + 1
        count = length(token >> 4)
        out += data[at : at + count]
        at += count
        if at >= len(data):
            break
        back, at = int.from_bytes(data[at : at + 2], "little"), at + 2
        count = length(token & MORE) + MATCH_MIN
        begin = len(out) - back
        while count:  # a match may overlap its own output
            part = out[begin : begin + count]
            out += part
            count -= len(part)
    return bytes(out)


def find_scope(names: list[Signal], wanted: str) -> str:
    """The module whose path ends with that of --scope; InputError if none or several match."""
    scopes = dict.fromkeys(signal.scope for signal in names)
    found = [scope for scope in scopes if f".{scope}".endswith(f".{wanted.strip('.')}")]
    if len(found) > 1:
        listed = ", ".join(found[:4])
        raise InputError(f"--scope {wanted}: could be {listed}; give more of its path")
    if not found:
        last = list(dict.fromkeys(scope.rpartition(".")[2] for scope in scopes))
        near = difflib.get_close_matches(wanted.rpartition(".")[2], last, 3, 0)
        raise InputError(f"--scope {wanted}: no such module; similar: {', '.join(near)}")
    return found[0]


def within(names: list[Signal], scope: str, levels: int) -> list[Signal]:
    """Signals of a module and its submodules. levels: of modules, the module itself included."""
    most = scope.count(".") + levels
    return [
        signal
        for signal in names
        if f"{signal.scope}.".startswith(f"{scope}.") and signal.scope.count(".") < most
    ]


DECLARED = 30  # bytes per signal in a VCD's header, without its name
CHANGE, WIDE = 4, 3  # bytes per value in a VCD, without its bits; extra if it has several bits
TIMES = 16  # bytes per cycle for its two time stamps

CHANGING = {
    "TOP.top.preprocess.points.": 0.3,
    "TOP.top.preprocess": 0.03,
    "TOP.top.render": 0.025,
    "TOP.top.axi": 0.025,
    "TOP": 0.2,
}
"""Share of nets that change per cycle, by prefix of their module's path. Measured on TINY: 0.26 to
0.33 in the points' arithmetic, which is never idle, 0.02 in its ports, 0.01 to 0.02 in rendering,
0.2 in the top itself; 0.4 in a stream that is never idle."""

FST = 0.15
"""Size of a FST relative to the VCD."""


def estimate(names: Sequence[Signal], cycles: int, kind: str) -> int:
    """Bytes of the waveforms of some signals over `cycles`, within a factor of three."""
    head = sum(DECLARED + len(signal.name) for signal in names)
    size = head + TIMES * cycles
    for signal in {signal.code: signal for signal in names}.values():
        value = CHANGE + signal.width + WIDE * (signal.width > 1)
        share = next(part for name, part in CHANGING.items() if signal.scope.startswith(name))
        size += value * (1 + share * cycles)
    return round(size * (FST if kind == "fst" else 1))
