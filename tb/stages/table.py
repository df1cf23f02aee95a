"""The table of stages: component, and cases from the golden model, for every harness."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from amaranth.lib import wiring

from splatcore.hdl.points.preprocess import Preprocess
from splatcore.hdl.raster.mark import Mark
from splatcore.hdl.raster.prepare import Prepare
from splatcore.hdl.raster.raster import Expand, Raster
from splatcore.hdl.raster.rasterizer import Rasterizer
from splatcore.hdl.raster.render import Render
from splatcore.hdl.raster.setup import Setup
from splatcore.hdl.sorting.cascade import Cascade
from splatcore.hdl.sorting.sort import Sort
from splatcore.hdl.sorting.subsort import SubSorter
from splatcore.hdl.top import Top
from splatcore.spec.axi import PREPROCESSING, RENDERING
from splatcore.spec.config import TINY
from splatcore.spec.record import Codes
from splatcore.study.bench.sort_parts import SortStage
from tb.helpers.bin_frames import BinFrames, Frame, bin_case, bin_frame
from tb.helpers.bin_splats import KINDS as SPLATS
from tb.helpers.bin_splats import splats, together
from tb.helpers.configs import ALPHA
from tb.helpers.parts import Handshake
from tb.helpers.runs import Case
from tb.stages.frames import MemoryCase, frame_cases
from tb.stages.on_bus import OnBus
from tb.stages.points import PARTS, at_the_bounds, frame, level_case, point_case
from tb.stages.primitives import Primitives, items
from tb.stages.raster import Lists, by_kind
from tb.stages.raster_steps import Pairs, exactly_reached
from tb.stages.sorting import batch_kinds, sort_kinds, spill_kinds

KINDS = ("empty", "full", "tie", "saturated")
"""Cases of each stage: no input; as much as fits, or more; equal numbers, or numbers at the bound
that they are compared with; numbers at the ends of their formats."""


@dataclass(frozen=True)
class Stage:
    """A stage on TINY.

    cases: by kind, the kinds of `KINDS` and others
    missing: why kinds are missing
    """

    component: Callable[[], wiring.Component]
    cases: Callable[[], dict[str, Case | MemoryCase]]
    missing: dict[str, str] = field(default_factory=dict)


def of_points(name: str, gaussians: int, **missing: str) -> Stage:
    """A stage that works on points, of frames of so many Gaussians."""
    config = ALPHA if name == "chunk" else TINY

    def cases() -> dict[str, Case]:
        frames = {kind: kind for kind in KINDS if kind not in missing}
        if name == "chunk":
            del frames["tie"]
            frames["empty"] = "behind"
        found = {
            kind: point_case(name, frame(of, gaussians, config)) for kind, of in frames.items()
        }
        found |= {kind: level_case(kind) for kind in ("tie", "far")} if name == "chunk" else {}
        return found | ({"tie": at_the_bounds(gaussians)} if name == "place" else {})

    return Stage(partial(PARTS[name], config), cases, missing)


def of_lists(component: Callable, splats: int, case: Callable[[Lists], Case], **missing) -> Stage:
    """A step of stage 3, of lists with so many splats."""
    return Stage(
        component, lambda: {kind: case(one) for kind, one in by_kind(splats).items()}, missing
    )


def bin_kinds() -> dict[str, Case]:
    """Full: the lists need more pages than there are. Tie: equal depths, as keys; order is kept."""
    size, each = (TINY.width_max, TINY.height_max), 8
    mixed = together(*(splats(TINY, kind, each, size) for kind in SPLATS))
    tied = together(*(splats(TINY, kind, each, size) for kind in ("common", "huge")))
    none = {name: codes[:0] for name, codes in mixed.items()}
    pages, near = bin_frame(TINY, Frame(mixed, *size)).lists.needed, TINY.arithmetic.encode(0.2)
    frames = {
        "empty": Frame(none, 17, 16),
        "full": Frame(mixed, *size, pages // 2),
        "tie": Frame(tied | {"z": np.full_like(tied["z"], int(near) + 1)}, 61, 35),
        "saturated": Frame(largest(tied), *size),
    }
    return {kind: bin_case(TINY, [one]) for kind, one in frames.items()}


def largest(codes: Codes) -> Codes:
    """The same splats with the largest depths and sizes of the format."""
    most = int(TINY.arithmetic.encode(TINY.arithmetic.max))
    names = ("z", "half_width", "half_height")
    return codes | {name: np.full_like(codes[name], most) for name in names}


LIVE = {"full": (1 << TINY.group**2) - 1, "some_live": 0b0110, "none_live": 0}


def expand_kinds() -> dict[str, Case]:
    """Cases by mask of the live tiles."""
    given, found = by_kind(100), {}
    for name, live in (LIVE | {"empty": LIVE["full"]}).items():
        lists = given["empty" if name == "empty" else "full"]
        inputs = {"i": lists.readied(), "positions": lists.positions()}
        found[name] = Case(inputs, {"o": Pairs.of(lists, live).pair_rows()}, {"live": live})
    return found


def setup_case(lists: Lists) -> Case:
    pairs = Pairs.of(lists)
    rows, care = pairs.around()
    return Case({"i": pairs.pair_rows()}, {"o": rows}, care={"o": care})


def mark_kinds() -> dict[str, Case]:
    """Tie: blocks that E reaches exactly."""
    found = {kind: Pairs.of(lists) for kind, lists in by_kind(100).items()}
    found["tie"] = exactly_reached(found["full"])
    return {
        kind: Case({"i": pairs.around()[0]}, {"o": pairs.marked()}) for kind, pairs in found.items()
    }


RASTERIZER = 1  # the machine's rasterizer that is tested alone


def rasterizer_case(lists: Lists) -> Case:
    rows, care = lists.blocks(RASTERIZER)
    inputs = {"i": Pairs.of(lists).owned(RASTERIZER), "positions": lists.positions()}
    return Case(inputs, {"o": rows}, lists.constants, {"o": care})


NOT_COMPARED = "it has no comparisons of splats"
IN_ORDER = "splats are blended in their input order, independent of their depths"
NOT_EMPTY = "a batch has at least one entry"

STAGES: dict[str, Stage] = {
    "streams": Stage(
        Primitives, lambda: {"empty": items(0), "full": items()},
        {"tie": "no part looks at payloads", "saturated": "no part looks at payloads"},
    ),
    "chunk": of_points("chunk", 2500),
    "cull": of_points("cull", 300),  # a full chunk and a part of one
    "place": of_points("place", 300),
    "project": of_points("project", 200, tie=NOT_COMPARED),
    "bin": Stage(partial(BinFrames, TINY), bin_kinds),
    "subsort": Stage(partial(SubSorter, TINY), lambda: batch_kinds(drop=0), {"empty": NOT_EMPTY}),
    "cascade": Stage(partial(Cascade, TINY), batch_kinds, {"empty": NOT_EMPTY}),
    "sort": Stage(partial(Sort, TINY), sort_kinds),
    "spill": Stage(
        partial(SortStage, TINY), spill_kinds, {"empty": "groups without entries have no list"}
    ),
    "prepare": of_lists(
        partial(Prepare, TINY), 200,
        lambda lists: Case({"i": lists.featured()}, {"o": lists.readied()}), tie=NOT_COMPARED,
    ),
    "expand": Stage(
        partial(Expand, TINY), expand_kinds,
        {"tie": NOT_COMPARED, "saturated": "splats pass unchanged"},
    ),
    "setup": of_lists(lambda: Handshake(Setup(TINY)), 100, setup_case, tie=NOT_COMPARED),
    "mark": Stage(lambda: Handshake(Mark(TINY)), mark_kinds),
    "rasterizer": of_lists(
        partial(Rasterizer, TINY, RASTERIZER), 300, rasterizer_case, tie=IN_ORDER
    ),
    "raster": of_lists(partial(Raster, TINY), 300, Lists.case, tie=IN_ORDER),
    "preprocess": Stage(
        lambda: OnBus(TINY, PREPROCESSING, Preprocess(TINY)),
        lambda: frame_cases("first_half", "model", "work_area"),
    ),
    "render": Stage(
        lambda: OnBus(TINY, RENDERING, Render(TINY)),
        lambda: frame_cases("second_half", "work_area", "image"),
    ),
    "top": Stage(partial(Top, TINY), lambda: frame_cases("no_ports", "model", "image")),
}  # fmt: skip
"""In the order of the pipeline; the last three are on memory."""
