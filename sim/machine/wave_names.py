"""Names in a file of waveforms: its modules and signals, of VCD and of FST."""

import difflib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from splatcore.spec.error import InputError

HIERARCHY = 6  # type of FST's block of names, compressed by LZ4
SCOPE, UPSCOPE = 254, 255  # what it holds besides signals
LENGTH = 8  # bytes of lengths in it
MATCH_MIN, MORE = 4, 15  # of LZ4: bytes of the shortest match; a length that goes on


@dataclass(frozen=True)
class Signal:
    """A signal. scope: its module, from TOP on; code: the same for names of one net."""

    scope: str
    name: str
    width: int
    code: str


def signals(path: Path) -> Iterator[Signal]:
    """Signals of a file of waveforms, by its end a FST or a VCD, in its order."""
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
    """Of a FST as Verilator writes it; the format is that of GTKWave's fstapi."""
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
    """The block of names of a FST."""
    at = 0
    while at < len(data):
        length = int.from_bytes(data[at + 1 : at + 1 + LENGTH])
        if data[at] == HIERARCHY:
            return _unpacked(data[at + 1 + 2 * LENGTH : at + 1 + length])
        at += 1 + length
    raise InputError("waveforms: the file has no names")


def _unpacked(data: bytes) -> bytes:
    """What a block of LZ4 holds."""
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
        while count:  # a match may overlap what it makes
            part = out[begin : begin + count]
            out += part
            count -= len(part)
    return bytes(out)


def find_scope(names: list[Signal], wanted: str) -> str:
    """The module whose path ends with that of --scope; InputError if it is none or several."""
    scopes = dict.fromkeys(signal.scope for signal in names)
    found = [scope for scope in scopes if f".{scope}".endswith(f".{wanted.strip('.')}")]
    if len(found) > 1:
        there = ", ".join(found[:4])
        raise InputError(f"--scope {wanted}: is one of {there}; say more of its path")
    if not found:
        last = list(dict.fromkeys(scope.rpartition(".")[2] for scope in scopes))
        near = difflib.get_close_matches(wanted.rpartition(".")[2], last, 3, 0)
        raise InputError(f"--scope {wanted}: there is no such module; near it: {', '.join(near)}")
    return found[0]


def within(names: list[Signal], scope: str, levels: int) -> list[Signal]:
    """Signals of a module and of the modules in it, so many levels, itself included."""
    most = scope.count(".") + levels
    return [
        signal
        for signal in names
        if f"{signal.scope}.".startswith(f"{scope}.") and signal.scope.count(".") < most
    ]
