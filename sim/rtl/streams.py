"""Run a component with streams on arrays of packed records, compiled by Verilator.

C++ (`stream.cpp`) drives the component: millions of cycles in seconds. Rows are uint8 [N, bytes],
one payload each, as packed by `spec.record.Record.pack`.
"""

import subprocess
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from amaranth.hdl import Shape
from amaranth.lib import stream, wiring

from splatcore.sim.rtl.build import CPP, SimulationError, build
from splatcore.sim.rtl.convert import converted
from splatcore.sim.rtl.coverage import counted
from splatcore.sim.rtl.verilator import state_of

IDLE_MAX = 20_000  # cycles without a transfer after which a run ends
TAIL = 64  # cycles after the last expected row, to detect additional rows

CYCLES_MAX = 1 << 62  # no limit
WORD = 64  # maximum width of a port whose values are an array of numbers

Rows = dict[str, np.ndarray]  # packed payloads, uint8 [N, bytes], by name of the stream


class StreamRuleError(AssertionError):
    """A component withdrew or changed an offer on a stream.

    result: results of the run until then
    """

    def __init__(self, message: str, result: "Result"):
        super().__init__(message)
        self.result = result


@dataclass(frozen=True)
class Result:
    """Results of a run.

    outputs: rows by output stream
    cycles: until the last expected row; the total if the run did not finish
    finished: whether all expected rows arrived; without expectations, whether all inputs were taken
    stopped: why the run ended, as text
    ports: final values of outputs that are not streams
    samples: values per cycle of the sampled ports: uint64 [cycles], or rows for ports over 64 bits
    taken: number of rows that the component accepted, by input stream
    """

    outputs: Rows
    cycles: int
    finished: bool
    stopped: str
    ports: dict[str, int]
    samples: dict[str, np.ndarray]
    taken: dict[str, int]


@dataclass(frozen=True)
class Ports:
    """Widths of a component's ports by Verilog name; of a stream's payload by the stream's name."""

    sources: dict[str, int]
    sinks: dict[str, int]
    driven: dict[str, int]
    read: dict[str, int]
    out: dict[str, int]  # all outputs, including those of streams

    @classmethod
    def of(cls, component: wiring.Component) -> "Ports":
        streams = {"__".join(map(str, path)) for path in _streams(component.signature)}
        ports = cls({}, {}, {}, {}, {})
        for path, member, _ in component.signature.flatten(component):
            name, owner = "__".join(map(str, path)), "__".join(map(str, path[:-1]))
            width, drives = Shape.cast(member.shape).width, member.flow is wiring.In
            if not drives and width:
                ports.out[name] = width
            if owner not in streams and width:  # Verilog has no ports of width 0
                (ports.driven if drives else ports.read)[name] = width
            elif owner in streams and path[-1] == "payload":
                if width == 0:
                    raise ValueError(f"stream {owner} has a payload of 0 bits")
                (ports.sources if drives else ports.sinks)[owner] = width
        return ports


class Simulation:
    """A compiled component; compiled programs are cached.

    samples: Verilog names of outputs, also of streams, to sample in every cycle
    source: Verilog to use instead of the component's own
    """

    def __init__(
        self, component: wiring.Component, samples: Iterable[str] = (), source: str | None = None
    ):
        self.ports, self.samples = Ports.of(component), tuple(samples)
        _check_names("output", self.samples, self.ports.out)
        source = source or converted(component, emit_src=counted())
        made = {"ports.hpp": _ports_header(self.ports, self.samples, source)}
        self.program = build(source, CPP / "stream.cpp", made)

    def run(
        self,
        inputs: Rows,
        *,
        constants: Mapping | None = None,
        stall: float = 0.0,
        seed: int = 0,
        expected: Mapping[str, int] | None = None,
        first: Iterable[str] = (),
        cycles_max: int | None = None,
        idle_max: int = IDLE_MAX,
    ) -> Result:
        """Reset the component, then run it until all expected rows arrive, it is idle, or a limit.

        inputs: rows for every input stream, possibly 0
        constants: for every other input a number, or one per cycle, [N] (rows if wider than 64
            bits); the last one stays
        stall: probability that a side of a stream idles in a cycle, in random and constant phases
        seed: of the stalls, and of the initial values of registers and memories
        expected: number of rows by output stream. When they have arrived and all inputs are taken,
            the run ends after 64 more cycles, with all outputs ready, to detect additional rows.
            Without it, the run ends after `idle_max` cycles without a transfer.
        first: input streams that are sent before the others begin
        Raises StreamRuleError if an offer is withdrawn, SimulationError if an assertion fails.
        """
        if not 0 <= stall < 1:
            raise ValueError(f"stall {stall} is not a probability below 1")
        _check_names("out stream", expected or {}, self.ports.sinks)
        _check_names("in stream", first, self.ports.sources)
        counts = [(expected or {}).get(name, -1) for name in self.ports.sinks]
        settings = [CYCLES_MAX if cycles_max is None else cycles_max, idle_max, seed % (1 << 64)]
        settings += [float(stall), int(expected is None and bool(self.ports.sinks)), *counts]
        files = self._files(inputs, constants or {})
        with TemporaryDirectory() as scratch:
            for name, rows in files.items():
                (Path(scratch) / name).write_bytes(rows.tobytes())
            command = [self.program, scratch, *map(str, settings), *state_of(seed)]
            command += [f"+first:{name}:" for name in first]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                log = "\n".join((done.stdout + done.stderr).splitlines()[-5:])
                raise SimulationError(f"the simulation failed, seed {seed}: {log}")
            return self._result(Path(scratch), done.stdout.splitlines(), files, expected, idle_max)

    def _files(self, inputs: Rows, constants: Mapping) -> Rows:
        """Rows for every source and driven port."""
        for kind, given, named in (
            ("inputs", inputs, self.ports.sources),
            ("constants", constants, self.ports.driven),
        ):
            if set(given) != set(named):
                raise ValueError(f"{kind} {sorted(given)} are not {sorted(named)}")
        files = {name: _checked(name, inputs[name], w) for name, w in self.ports.sources.items()}
        for name, width in self.ports.driven.items():
            files[name] = _checked(name, _rows(name, constants[name], width), width)
        return files

    def _result(self, folder: Path, report: list, files: Rows, expected, idle_max: int) -> Result:
        """The result from the program's files and its output."""
        why, total, last, rule = report[:4]
        total, last = int(total), int(last)

        def read(name: str, width: int) -> np.ndarray:
            return np.fromfile(folder / name, np.uint8).reshape(-1, ceil(width / 8))

        outputs = {name: read(name, width) for name, width in self.ports.sinks.items()}
        taken = dict(zip(self.ports.sources, map(int, report[4:]), strict=True))
        rest = [f"{name} took {n} of {len(files[name])}" for name, n in taken.items()]
        complete = all(n == len(files[name]) for name, n in taken.items())
        if expected is None:
            rest += [f"{name} gave {len(rows)}" for name, rows in outputs.items()]
            finished = why == "done" or (why == "idle" and complete)
        else:
            rest += [f"{name} gave {len(outputs[name])} of {n}" for name, n in expected.items()]
            finished = why != "rule" and all(len(outputs[k]) >= n for k, n in expected.items())
        reasons = {
            "done": f"all rows arrived, then {TAIL} more cycles passed",
            "idle": f"nothing moved for {idle_max} cycles, up to cycle {total}",
            "limit": f"the limit of {total} cycles was reached",
            "rule": f"the stream rule was broken in cycle {total}",
        }
        result = Result(
            outputs=outputs,
            cycles=last if finished else total,
            finished=finished,
            stopped=f"{reasons[why]}: {', '.join(rest)} rows" if rest else reasons[why],
            ports={
                name: int.from_bytes(read(f"end.{name}", width).tobytes(), "little")
                for name, width in self.ports.read.items()
            },
            samples={
                name: _values(read(f"sample.{name}", self.ports.out[name])) for name in self.samples
            },
            taken=taken,
        )
        if why == "rule":
            name, violation = rule.split(" ", 1)
            raise StreamRuleError(
                f"stream {name}: {violation} before ready was high, in cycle {total}", result
            )
        return result


def _streams(signature: wiring.Signature, path: tuple = ()) -> Iterator[tuple]:
    """Paths of the streams among a signature's members."""
    for name, member in signature.members.items():
        if member.is_port:
            continue
        for index in np.ndindex(*member.dimensions):
            inner = (*path, name, *index)
            if isinstance(member.signature, stream.Signature):
                yield inner
            else:
                yield from _streams(member.signature, inner)


def _ports_header(ports: Ports, samples: tuple[str, ...], source: str) -> str:
    """A component's ports for `stream.cpp`."""

    def listed(macro: str, widths: Mapping[str, int]) -> str:
        # Verilator writes two underscores as ___05F.
        return ", ".join(
            f'{macro}("{name}", {name.replace("__", "___05F")}, {width})'
            for name, width in widths.items()
        )

    sampled = [listed("SAMPLE", {k: ports.out[k] for k in samples}), listed("END", ports.read)]
    lines = {
        "HAS_CLOCK": int("\n  input clk;" in source),
        "HAS_RESET": int("\n  input rst;" in source),
        "TAIL": TAIL,
        "SOURCES": listed("SOURCE", ports.sources),
        "SINKS": listed("SINK", ports.sinks),
        "DRIVEN_PORTS": listed("DRIVEN", ports.driven),
        "SAMPLED_PORTS": ", ".join(filter(None, sampled)),
    }
    return "".join(f"#define {name} {value}\n" for name, value in lines.items())


def _check_names(kind: str, given: Iterable[str], known: Iterable[str]) -> None:
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise ValueError(f"no {kind} {', '.join(unknown)}: {', '.join(known)}")


def _checked(name: str, rows: np.ndarray, width: int) -> np.ndarray:
    """Check the shape of rows, and that bits above the width are 0."""
    rows, size = np.asarray(rows), ceil(width / 8)
    if rows.dtype != np.uint8 or rows.ndim != 2 or rows.shape[1] != size:
        raise ValueError(f"{name}: {rows.dtype} {rows.shape} is not uint8 [N, {size}]")
    if width % 8 and (rows[:, -1] >> (width % 8)).any():
        raise ValueError(f"{name}: a row has bits above its {width}")
    return rows


def _rows(name: str, value, width: int) -> np.ndarray:
    """Convert a number, numbers [N] or rows to rows."""
    if isinstance(value, np.ndarray) and value.ndim == 2:
        return value
    if np.ndim(value) == 0:
        value = int(value)
        if not -(1 << width) // 2 <= value < 1 << width:
            raise ValueError(f"{name}: {value} does not fit in {width} bits")
        value = (value % (1 << width)).to_bytes(ceil(width / 8), "little")
        return np.frombuffer(value, np.uint8)[np.newaxis]
    if width > WORD:
        raise ValueError(f"{name}: numbers for a port of {width} bits; pass rows")
    words = np.ascontiguousarray(value, "<u8").view(np.uint8).reshape(-1, WORD // 8)
    if words[:, ceil(width / 8) :].any():
        raise ValueError(f"{name}: a number does not fit in {width} bits")
    return words[:, : ceil(width / 8)]


def _values(rows: np.ndarray) -> np.ndarray:
    """Convert rows to numbers, unless they are too wide."""
    if rows.shape[1] > WORD // 8:
        return rows
    padded = np.zeros((len(rows), WORD // 8), np.uint8)
    padded[:, : rows.shape[1]] = rows
    return padded.view("<u8")[:, 0]
