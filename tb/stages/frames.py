"""Frames for stages on memory: its contents before, and the expected contents afterwards."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from amaranth.hdl import Const
from amaranth.lib import data

from splatcore.golden.pipeline import Frame, render
from splatcore.hdl.lib.record import AREA, frame_layout
from splatcore.hdl.raster.job import job_layout
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.generate.hard import HARD
from splatcore.model.generate.hard_case import straight_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.areas import BASE, GAP, place_areas
from splatcore.sim.machine.machine import Job, frame_values
from splatcore.spec.axi import BEAT
from splatcore.spec.config import TINY
from splatcore.spec.feature import feature_record
from splatcore.spec.raster import COLOURS, colours
from splatcore.spec.sort import half_entries
from splatcore.spec.work import FEATURE, SLOT, aligned, table_record

MOVED = ("MODEL", "GROUPS", "LISTS", "FEATURES", "SCRATCH", "PIXELS")
"""Address registers; these memories begin at 0."""

Bytes = list[tuple[int, bytes]]
"""Contents of memory: address and bytes."""


@dataclass(frozen=True, eq=False)
class FrameCase:
    """A frame in memory. values: of its registers; golden: the golden model's frame."""

    job: Job
    values: dict[str, int]
    golden: Frame
    regions: tuple[tuple[int, int, bool], ...]  # begin, end, writable; of all frames

    def model(self) -> Bytes:
        """The packed model."""
        return [(self.values["MODEL"], self.job.model.image.tobytes())]

    def work_area(self) -> Bytes:
        """Results of the first half."""
        binned, lists = self.golden.binned, self.golden.binned.lists
        table = {"page": lists.page.astype(np.uint64), "count": lists.count.astype(np.uint64)}
        table["reserved"] = np.zeros(len(lists.page), np.uint64)
        features = np.zeros((len(binned.kept), FEATURE), np.uint8)
        features[:, : feature_record(TINY).size] = feature_record(TINY).pack(binned.features)
        at, burst = self.values["LISTS"], TINY.burst * SLOT
        return [
            (self.values["GROUPS"], table_record().pack(table).tobytes()),
            (self.values["FEATURES"], features.tobytes()),
            *(
                (at + int(address) * burst, slots.astype("<u8").tobytes())
                for address, slots in zip(lists.address, lists.slots, strict=True)
            ),
        ]

    def image(self) -> Bytes:
        """The pixels, row by row."""
        at, step = self.values["PIXELS"], self.values["STRIDE"]
        return [(at + k * step, row.tobytes()) for k, row in enumerate(self.golden.pixels)]

    def area(self) -> dict[str, int]:
        """The work area, in beats."""
        names = ("groups", "lists", "features")
        return {name: self.values[name.upper()] // BEAT for name in names}

    def first_half(self) -> dict[str, int]:
        """Ports of `hdl.points.preprocess` for this frame."""
        values = {name.lower(): value for name, value in self.values.items()}
        return {"frame": bits(frame_layout(TINY), values), "area": bits(AREA, self.area())}

    def second_half(self) -> dict[str, int]:
        """Ports of `hdl.raster.render` for this frame."""
        background = dict(zip(COLOURS, self.job.background, strict=True))
        job = {"width": self.values["WIDTH"], "height": self.values["HEIGHT"]}
        job |= {"background": background, "area": self.area()}
        for name in ("scratch", "pixels", "stride"):
            job[name] = self.values[name.upper()] // BEAT
        return {"job": bits(job_layout(TINY), job)}

    def no_ports(self) -> dict[str, int]:
        return {}


@dataclass(frozen=True, eq=False)
class MemoryCase:
    """A frame for a stage on memory.

    ports: of the stage, constant during the frame
    registers: values of the frame's registers
    regions: (begin, end, writable) of what the machine may access
    before, after: contents of memory before, and expected contents after the frame
    """

    ports: dict[str, int]
    registers: dict[str, int]
    regions: tuple[tuple[int, int, bool], ...]
    before: Bytes
    after: Bytes

    def numbers(self) -> dict:
        """Convert to JSON values."""
        before, after = (
            [(address, given.hex()) for address, given in part]
            for part in (self.before, self.after)
        )
        return vars(self) | {"before": before, "after": after}


def bits(layout: data.Layout, values: dict) -> int:
    """Pack values of a layout's fields into the value of a port."""
    return Const.cast(layout.const(values)).value


def jobs() -> dict[str, Job]:
    """A frame of each kind: no Gaussian; lists that do not fit on chip; equal depths; opaque or
    nearly opaque colours beyond 0 and 1 on the brightest background."""
    camera, straight = generated_camera("garden", 61, 35), straight_camera()
    most = (1 << colours(TINY)["red"].width) - 1
    tied, bright = HARD["equal_depths"](0).scene[:60], HARD["saturated_colours"](0).scene[::5]
    packed = {
        "empty": (HARD["empty"](0).scene, straight, (0, most, 0)),
        "full": (generate("garden", 350), camera, (0, 0, 0)),
        "tie": (tied, straight, (0, 0, 0)),
        "saturated": (replace(bright, scale=bright.scale * 4), straight, (most, most, 0)),
    }
    return {
        name: Job(pack(scene, TINY)[0], camera, background)
        for name, (scene, camera, background) in packed.items()
    }


@cache
def frames() -> dict[str, FrameCase]:
    """The frames, each with its own model and image; they share one work area."""
    given, found = jobs(), {}
    models = [job.model for job in given.values()]
    areas = place_areas(
        TINY, models, [(job.camera.width, job.camera.height) for job in given.values()]
    )
    end = areas.end - BASE
    regions = [
        (region.begin - BASE, region.end - BASE, region.writable)
        for region in areas.regions
        if not region.name.startswith("image")
    ]
    for number, (name, job) in enumerate(given.items()):
        values = frame_values(TINY, job, number, areas, 0)
        values |= {name: values[name] - BASE for name in MOVED}
        values["PIXELS"], size = end + GAP, values["STRIDE"] * values["HEIGHT"]
        end += GAP + aligned(size)
        regions.append((values["PIXELS"], values["PIXELS"] + size, True))
        found[name] = (job, values)
    found = {
        name: FrameCase(job, values, render(TINY, *job), tuple(regions))
        for name, (job, values) in found.items()
    }
    assert np.diff(found["full"].golden.start).max() > half_entries(TINY)
    return found


def frame_cases(ports: str, before: str, after: str) -> dict[str, MemoryCase]:
    """The frames for a stage. ports, before, after: methods of `FrameCase`."""
    return {
        name: MemoryCase(
            getattr(frame, ports)(), frame.values, frame.regions,
            getattr(frame, before)(), getattr(frame, after)(),
        )
        for name, frame in frames().items()
    }  # fmt: skip
