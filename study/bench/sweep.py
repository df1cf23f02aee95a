"""Machines of `splatcore bench sweep`, and tasks of campaigns: many machines on one view.

Pictures are the golden model's, compared with the float64 reference on the same packed model and
on the scene as trained. Cycles are the cycle model's. Machines that differ only in speed share a
picture.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import product
from pathlib import Path

from splatcore.golden.pipeline import render
from splatcore.model.pack.pack import packing_key
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.metric import against
from splatcore.sim.frame.shot import Shot, View, judge
from splatcore.sim.frame.source import opened
from splatcore.spec.config import CLOCK_HZ, DEFAULT, FORMATS, PAPER, Config
from splatcore.study.accuracy.points import width_of, with_width
from splatcore.study.bench.campaign import Task

LANES = {"block": 16, "quads": 8}  # of a rasterizer

PES = (9, DEFAULT.pes)  # a Gaussian every 6 cycles, every 4


@dataclass(frozen=True)
class Point:
    """A machine of the sweep. knob: name of the change from DEFAULT; value: its setting."""

    name: str
    knob: str
    value: str
    config: Config

    @property
    def fields(self) -> dict[str, object]:
        """Fields of `Config` that differ from DEFAULT's; as text unless JSON can represent them."""
        found = {}
        for field in fields(Config):
            value = getattr(self.config, field.name)
            if field.name != "name" and value != getattr(DEFAULT, field.name):
                found[field.name] = value if isinstance(value, int | str) else str(value)
        return found


WIDTHS = ("5/10", "7/10", "7/13", "8/20")
"""Exponent/fraction bits of stages 0 and 1 to try in addition to DEFAULT's."""

KEYS = (17, 18, 19, 20)
"""Bits of a depth key to try in addition to DEFAULT's."""

RASTER_FORMATS = {
    "coarse": {field: format.coarse for field, format in FORMATS.items()},
    "weights -1 bit": {"weight": 10, "sum_fraction": 12},
    "fine": {field: format.fine for field, format in FORMATS.items()},
}
"""Sets of formats of stage 3: all a little narrower, the weight narrower, all a little wider."""

LIMITS, FAINT, ENDS = (4, 5, 6), (9, 11, 13), (7, 9)
"""Faintness rules to try: once T < 2^−limit, splats that would take less than 2^−faint are skipped,
and one that would leave less than 2^−end takes all of T."""


def changed(knob: str, value: object, **changes) -> Point:
    """DEFAULT with some fields changed."""
    name = f"{knob} {value}"
    return Point(name, knob, str(value), replace(DEFAULT, name=name, **changes))


def points() -> Iterator[Point]:
    """All points of the sweep."""
    yield Point("DEFAULT", "preset", "DEFAULT", DEFAULT)
    yield Point("PAPER", "preset", "PAPER", PAPER)
    for text in WIDTHS:
        config = with_width(text)
        changes = {
            field: getattr(config, field) for field in ("arithmetic", "depth", "screen_exponent")
        }
        yield changed("float", width_of(config), **changes)
    for bits in KEYS:
        yield changed("key", bits, sort_digits=(1,) * bits)
    for name, changes in RASTER_FORMATS.items():
        yield changed("raster format", name, **changes)
    for (kind, own), count, pes in product(LANES.items(), (16, 32, 64, 128), PES):
        name = f"{count}, {kind}, {pes} PEs"
        point = changed("lanes", name, rasterizers=count // own, lanes=kind, pes=pes)
        if point.fields:  # not DEFAULT itself
            yield point
    for limit, below in product(LIMITS, FAINT):
        faint = DEFAULT.faint._replace(dark=limit, taken=below)
        if faint != DEFAULT.faint:
            yield changed("faint", f"T 1/{1 << limit}, below 1/{1 << below}", faint=faint)
    for end in ENDS:
        name = f"the rest below 1/{1 << end}"
        yield changed("faint", name, faint=DEFAULT.faint._replace(ends=end))
    yield changed("faint", "off", faint=())
    yield changed("PEs", 6, pes=6)
    for count in (1, 2, 4):
        yield changed("sub-sorters", f"{count}, OR-trees", sub_sorter="trees", sub_sorters=count)
    yield changed("port", "128 bits", port=128)
    yield changed("tile test", "3sigma", tile_test="3sigma")
    for tiles in (1, 2):
        yield changed("group", tiles, group=tiles)


SPEED = (
    "name", "pe_arrays", "pes", "skip_zeros", "multiply_latency", "add_latency", "unary_latency",
    "projection_slots", "sub_sorter", "sub_sorters", "sub_sorter_entries",
    "merge_ways", "rasterizers", "lanes", "port", "energy",
)  # fmt: skip
"""Fields of `Config` that change neither pixels nor counts of work."""


def picture_of(config: Config) -> Config:
    """The machine that represents all machines with the same pictures."""
    return replace(config, **{name: getattr(DEFAULT, name) for name in SPEED})


def tasks(name: str, views: list[View], machines: dict[str, Config]) -> list[Task]:
    """Tasks of a campaign, one per view and distinct picture. name: of the campaign."""
    pictures: dict[Config, dict[str, Config]] = {}
    for label, config in machines.items():
        pictures.setdefault(picture_of(config), {})[label] = config
    found = []
    for view in views:
        for some in pictures.values():
            about = f"{name} {view} {[(label, repr(config)) for label, config in some.items()]}"
            title = f"{view.name} {view.size} {next(iter(some))}".replace("/", "-")
            found.append(Task(title.replace(":", "-"), about, measure, (view, some)))
    return found


def measure(view: View, machines: dict[str, Config]) -> dict:
    """Measure machines with the same picture on a view: {"rows": [one row per machine]}."""
    first = next(iter(machines.values()))
    shot = packed_by(view, PACKERS.setdefault(packing_key(first), first))
    frame = render(first, shot.model, shot.camera)
    facts = against(judge(frame, shot)) | {
        "counts": frame.counts | {"front": len(frame.points.front)},
    }
    about, rows = {"scene": Path(view.scene).name, "camera": view.camera or shot.camera.name}, []
    for label, config in machines.items():
        cycles = frame_cycles(config, frame)
        speed = {"cycles": cycles.by_name, "fps_at_800mhz": CLOCK_HZ / cycles.frame}
        rows.append({"point": label} | about | speed | facts)
    return {"rows": rows}


PACKERS: dict[tuple, Config] = {}
"""A machine that stands for all that pack alike, by `packing_key`."""


@lru_cache(maxsize=8)
def packed_by(view: View, machine: Config) -> Shot:
    """A view's frame, whose packed model and pictures of the reference the process keeps."""
    return view.open(machine, opened(view.scene, view.reading))
