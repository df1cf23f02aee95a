"""Stages 0 and 1 in simulation: input rows and expected output rows."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from amaranth.lib import wiring

from splatcore.hdl.points.chunk import Chunk
from splatcore.hdl.points.cull import Cull
from splatcore.hdl.points.place import Place
from splatcore.hdl.points.points import COUNTED, Points
from splatcore.hdl.points.project import Project
from splatcore.sim.machine.counted import point_counts
from splatcore.sim.rtl.streams import Result
from splatcore.spec.config import Config
from splatcore.spec.point import chunk_record, culling_record, placing_record, projecting_record
from tb.helpers.point_rows import PointRows, only_flags
from tb.helpers.runs import Rows, check_run, compiled, counters

STAGES: dict[str, Callable[[Config], wiring.Component]] = {
    "chunk": Chunk,
    "cull": Cull,
    "place": Place,
    "project": Project,
    "points": Points,
}

STREAMS = {
    "chunk": ({"i": "headers"}, {"o": "chunks"}),
    "cull": ({"chunks": "culling", "positions": "positions"}, {"o": "culled"}),
    "place": ({"i": "culled", "chunks": "placing"}, {"o": "placed"}),
    "project": (
        {"i": "placed", "chunks": "projecting", "attributes": "attributes", "write": "write"},
        {"wanted": "wanted", "o": "splats"},
    ),
    "points": (
        {name: name for name in ("headers", "positions", "attributes", "write")},
        {name: name for name in ("fetch", "wanted", "splats")},
    ),
}
"""Input and output streams of each stage: name in `PointRows.streams` by port."""


@dataclass(frozen=True, eq=False)
class Case:
    """A component, its input rows, its other inputs, and the expected output rows."""

    component: wiring.Component
    inputs: Rows
    constants: dict[str, int]
    expected: Rows

    @property
    def first(self) -> list[str]:
        """Streams to send first: writes to the codebook."""
        return [name for name in self.inputs if name == "write"]


def case(stage: str, rows: PointRows) -> Case:
    """A stage's case from the golden results of a frame."""
    config, streams = rows.config, dict(rows.streams)
    chunks = chunk_record(config).unpack(streams["chunks"])
    for record in (culling_record(config), placing_record(config), projecting_record()):
        streams[record.name] = record.pack(chunks[record.name])
    component = STAGES[stage](config)
    sources, sinks = STREAMS[stage]
    return Case(
        component,
        {port: streams[name] for port, name in sources.items()},
        constants(component, rows),
        settled_outputs(stage, config, {port: streams[name] for port, name in sinks.items()}),
    )


def settled_outputs(stage: str, config: Config, outputs: Rows) -> Rows:
    """Rows of a stage's output streams, with zeros for bits that do not matter."""
    coordinates, found = {"culled": "z", "placed": "x y z"}, dict(outputs)
    for port, name in STREAMS[stage][1].items():
        if name in coordinates:
            found[port] = only_flags(config, coordinates[name], outputs[port])
    return found


def constants(component: wiring.Component, rows: PointRows) -> dict[str, int]:
    """Values of a component's ports that are constant during a frame."""
    ports = {"clear": 0} | rows.registers
    return {name: ports[name] for name in component.signature.members if name in ports}


def check(stage: str, frame: PointRows, stall: float, seed: int = 0) -> Result:
    """Compare a stage's outputs with the golden model's, bit by bit, and the counters."""
    given = case(stage, frame)
    result = check_run(
        compiled(STAGES[stage], frame.config), given.inputs, given.expected, f"{stage}.",
        partial(settled_outputs, stage, frame.config), constants=given.constants,
        first=given.first, stall=stall, seed=seed,
    )  # fmt: skip
    if stage == "points":
        counted = counters(COUNTED, result.ports["counters"])
        expected = point_counts(frame.points)
        assert {name: counted[name] for name in expected} == expected
    return result
