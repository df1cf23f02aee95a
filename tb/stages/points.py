"""Stages 0 and 1: cases from the golden model's frames."""

from dataclasses import replace
from functools import cache

import numpy as np
from amaranth.lib import wiring

from splatcore.golden.points import RAY, place
from splatcore.golden.program import run
from splatcore.hdl.points.chunk import Chunk
from splatcore.hdl.points.cull import Cull
from splatcore.hdl.points.place import Place
from splatcore.hdl.points.points import COUNTED, Points
from splatcore.hdl.points.project import Project
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.generate.hard_case import straight_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.counted import point_counts
from splatcore.sim.rtl.streams import Result
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import TINY, Config
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.memory import chunk_count
from splatcore.spec.microprogram import program
from splatcore.spec.point import (
    chunk_record,
    culling_record,
    placing_record,
    point_record,
    projecting_record,
)
from splatcore.spec.scene import Scene
from tb.helpers.configs import ALPHA
from tb.helpers.level_models import STRAIGHT, clouds, ties
from tb.helpers.point_rows import PointRows, care_of, point_rows
from tb.helpers.point_rows import values as codes
from tb.helpers.runs import Case, compiled, counters

PARTS = {"chunk": Chunk, "cull": Cull, "place": Place, "project": Project, "points": Points}

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


def point_case(stage: str, rows: PointRows) -> Case:
    """A stage's part of a frame; writes to the codebook come first."""
    config, streams = rows.config, dict(rows.streams)
    chunks = chunk_record(config).unpack(streams["chunks"])
    for record in (culling_record(config), placing_record(config), projecting_record()):
        streams[record.name] = record.pack(chunks[record.name])
    sources, sinks = STREAMS[stage]
    return Case(
        {port: streams[name] for port, name in sources.items()},
        {port: streams[name] for port, name in sinks.items()},
        constants(PARTS[stage](config), rows.registers),
        {port: rows.care[name] for port, name in sinks.items() if name in rows.care},
        [name for name in sources if name == "write"],
    )


def constants(component: wiring.Component, registers: dict[str, int]) -> dict[str, int]:
    """Values of a component's ports that are constant during a frame."""
    found = {"clear": 0} | registers
    return {name: found[name] for name in component.signature.members if name in found}


def check(stage: str, frame: PointRows, stall: float, seed: int = 0) -> Result:
    """Compare a stage's outputs with the golden model's, bit by bit, and the counters."""
    part = compiled(PARTS[stage], frame.config)
    result = point_case(stage, frame).check(part, f"{stage}.", stall=stall, seed=seed)
    if stage == "points":
        counted = counters(COUNTED, result.ports["counters"])
        expected = point_counts(frame.points)
        assert {name: counted[name] for name in expected} == expected
    return result


WIDTH, HEIGHT = 64, 48
GARDEN = generated_camera("garden", WIDTH, HEIGHT)
AMID = replace(GARDEN, translation=GARDEN.translation - [0, 0, 6])
"""A camera with a part of the garden behind it, and a part outside of its view."""
BEYOND = replace(GARDEN, translation=GARDEN.translation - [0, 0, 1000])
"""A camera with all of the garden behind it."""

HUGE = 1e19
"""Factor that scales a scene's depths beyond the arithmetic's largest number."""

STEP = 2.0**-20  # distance in scene units of Gaussians around the near plane
FEW = 33  # Gaussians of frames at a bound


def with_harmonics(scene: Scene, rng: np.random.Generator) -> Scene:
    """A scene with random harmonics of degree 3."""
    sh = np.concatenate([scene.sh[:, :1], 0.1 * rng.normal(size=(len(scene), 15, 3))], axis=1)
    return replace(scene, sh=sh)


def level_case(kind: str) -> Case:
    """The chunk unit on a model with levels: from afar, or with errors equal to the limit."""
    model, camera = clouds(ALPHA, 9)[1], replace(GARDEN, lod_pixels=0.25)
    if kind == "tie":
        model, camera = ties(model), STRAIGHT
    elif kind == "far":
        camera = replace(camera, translation=np.add(camera.translation, [0, 0, 10]))
    return point_case("chunk", point_rows(ALPHA, model, camera))


@cache
def frame(kind: str, count: int, config: Config = TINY) -> PointRows:
    """A frame of about `count` Gaussians with harmonics of all layouts, or a frame of a few.

    kind: one of `KINDS`; with "empty" a chunk is read and all its points are culled; or "behind":
        no chunk is read
    """
    rng = np.random.default_rng(3)
    scene = with_harmonics(generate("garden", count), rng)
    camera = BEYOND if kind == "behind" else AMID
    if kind in ("tie", "empty"):
        scene = on_the_near_plane(scene, FEW // 2 if kind == "tie" else -2)
        camera = straight_camera(WIDTH, HEIGHT)
    elif kind == "saturated":
        scene = replace(scene[:FEW], position=scene.position[:FEW] * HUGE)
        camera = replace(GARDEN, translation=GARDEN.translation * HUGE)
    mixed = rng.integers(0, len(LAYOUTS), chunk_count(len(scene)))
    quality = mixed if kind == "full" else "compact"
    return point_rows(config, pack(scene, config, quality=quality)[0], camera)


def on_the_near_plane(scene: Scene, beyond: int) -> Scene:
    """Gaussians on the optical axis of the straight camera, around the near plane.

    beyond: steps from the near plane to the last one
    """
    steps = np.arange(FEW) - FEW + 1 + beyond
    near = float(TINY.arithmetic.round(NEAR_PLANE))
    place = np.stack([0 * steps, 0 * steps, near + steps * STEP], axis=1)
    return replace(scene[:FEW], position=place)


def at_the_bounds(count: int) -> Case:
    """Points at the bounds of the guard band, some exactly, each in its own chunk."""
    rows = frame("full", count)
    points, fixed = rows.points, rows.points.frame.constants
    here = np.isin(points.points, points.front)
    fields = {name: points.culled[name][here] for name in ("z", "z_low", *RAY)}
    margins = {"margin_x": 0 * fields["z"], "margin_y": 0 * fields["z"]}
    found = run(TINY, program("place"), fixed | fields | margins)
    for axis in "xy":
        beyond = np.abs(found[axis]) - found[f"bound_{axis}"]
        margins[f"margin_{axis}"] = TINY.arithmetic.round(beyond)
    found, kept = place(TINY, points.frame, fields | margins)
    for axis in "xy":
        assert (np.abs(found[axis]) == found[f"bound_{axis}"])[kept].any()
    assert 0 < kept.sum() < len(kept)
    one, every = np.ones(len(kept), np.uint64), np.arange(len(kept))
    flags = {"place": 0 * one, "last": one}
    record = point_record(TINY, "z")
    given = record.pack(flags | {"kept": one} | codes(record, fields, every))
    record = point_record(TINY, "x y z")
    expected = flags | {"kept": kept.astype(np.uint64)} | codes(record, fields | found, every)
    chunks = placing_record(TINY).pack(codes(placing_record(TINY), margins, every))
    out, usual = record.pack(expected), point_case("place", rows)
    care = {"o": care_of(TINY, "x y z", out)}
    return Case({"i": given, "chunks": chunks}, {"o": out}, usual.constants, care)
