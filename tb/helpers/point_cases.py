"""Cases of the stages that work on points: frames of small models."""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.golden.points import RAY, place
from splatcore.golden.program import run
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.generate.hard_case import straight_camera
from splatcore.model.pack.pack import pack
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import TINY
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.memory import chunk_count
from splatcore.spec.microprogram import program
from splatcore.spec.point import placing_record, point_record
from splatcore.spec.scene import Scene
from tb.helpers.feeds import Feed
from tb.helpers.point_rows import PointRows, point_rows
from tb.helpers.point_rows import values as codes
from tb.helpers.stage_cases import STREAMS, Case, case

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


@cache
def frame(kind: str, count: int) -> PointRows:
    """A frame of about `count` Gaussians with harmonics of all layouts, or a frame of a few.

    kind: one of `tb.helpers.feeds.KINDS`; with "empty" a chunk is read and all its points are
        culled; or "behind": no chunk is read
    """
    rng, scene = np.random.default_rng(3), generate("garden", count)
    sh = np.concatenate([scene.sh[:, :1], 0.1 * rng.normal(size=(len(scene), 15, 3))], axis=1)
    scene = replace(scene, sh=sh)
    camera = BEYOND if kind == "behind" else AMID
    if kind in ("tie", "empty"):
        scene = on_the_near_plane(scene, FEW // 2 if kind == "tie" else -2)
        camera = straight_camera(WIDTH, HEIGHT)
    elif kind == "saturated":
        scene = replace(scene[:FEW], position=scene.position[:FEW] * HUGE)
        camera = replace(GARDEN, translation=GARDEN.translation * HUGE)
    mixed = rng.integers(0, len(LAYOUTS), chunk_count(len(scene)))
    quality = mixed if kind == "full" else "compact"
    return point_rows(TINY, pack(scene, TINY, quality=quality)[0], camera)


def on_the_near_plane(scene: Scene, beyond: int) -> Scene:
    """Gaussians on the optical axis of the straight camera, around the near plane.

    beyond: steps from the near plane to the last one
    """
    steps = np.arange(FEW) - FEW + 1 + beyond
    near = float(TINY.arithmetic.round(NEAR_PLANE))
    place = np.stack([0 * steps, 0 * steps, near + steps * STEP], axis=1)
    return replace(scene[:FEW], position=place)


def feed(stage: str, kind: str, count: int) -> Feed:
    """A stage's part of a frame, as a feed."""
    return feed_of(stage, case(stage, frame(kind, count)))


def feed_of(stage: str, given: Case) -> Feed:
    """Convert a case of the C++ harness to a feed for cocotb."""
    care = {
        port: care_of({"culled": "z", "placed": "x y z"}[name], given.expected[port])
        for port, name in STREAMS[stage][1].items()
        if name in ("culled", "placed")
    }
    return Feed(given.inputs, given.expected, given.constants, care, given.first)


def care_of(coordinates: str, rows: np.ndarray) -> np.ndarray:
    """Ones where bits of rows of points matter: not in numbers of points that are not kept."""
    record = point_record(TINY, coordinates)
    kept, found = record.unpack(rows)["kept"], {}
    for name, format in record.fields:
        ones = np.full(len(rows), (1 << format.width) - 1, np.uint64)
        found[name] = ones if name in ("place", "last", "kept") else np.where(kept, ones, 0)
    return record.pack(found)


def at_the_bounds(count: int) -> Feed:
    """Points at the bounds of the guard band, some exactly, each in its own chunk."""
    rows = frame("full", count)
    points, constants = rows.points, rows.points.frame.constants
    here = np.isin(points.points, points.front)
    fields = {name: points.culled[name][here] for name in ("z", "z_low", *RAY)}
    margins = {"margin_x": 0 * fields["z"], "margin_y": 0 * fields["z"]}
    found = run(TINY, program("place"), constants | fields | margins)
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
    out = record.pack(expected)
    given = {"i": given, "chunks": chunks}
    return Feed(given, {"o": out}, case("place", rows).constants, {"o": care_of("x y z", out)})
