"""Pictures and numbers of a scene, on request: golden model, reference, error maps, RTL."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from splatcore.app.view import layers
from splatcore.golden import pipeline
from splatcore.model.pack.pack import packing_key
from splatcore.sim.frame import engines
from splatcore.sim.frame.metric import against, difference
from splatcore.sim.frame.picture import error_picture
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import Source
from splatcore.spec.camera import Camera
from splatcore.spec.config import CLOCK_HZ, Config

Report = Callable[[str, float | None], None]
"""Progress callback, called with the current step and the share done (0 … 1; None: unknown). An
exception that it raises aborts the work."""


@dataclass(frozen=True)
class Request:
    """A page's request for a picture.

    quality: packing; None: the smallest that is good enough for the first requested view
    layer: of `layers.LAYERS`, or `layers.RTL`
    """

    camera: Camera
    config: Config
    quality: str | None = None
    layer: str = layers.MACHINE


@dataclass(frozen=True)
class Shown:
    """An answer to a request, complete or not.

    pixels: [H, W, 3], the layer; None: not ready yet
    facts: for `text.facts_text`
    done: True for the last answer
    """

    pixels: np.ndarray | None
    facts: dict = field(default_factory=dict)
    done: bool = False


KEPT_CAMERAS = 16
"""Cameras whose pictures are kept: 19 MB each at 1920×1080."""

CHOOSING = "choosing a quality"


class Studio:
    """A source, the pictures and numbers of the last cameras, and the frames of the last one.

    packing: True while a scene is packed, which the next cameras need, too
    """

    def __init__(self, source: Source):
        self.source, self.packing = source, False
        self._views: dict[tuple, dict] = {}  # kept values by camera, the last one at the end
        self._frames: dict[object, pipeline.Frame] = {}  # large, so only of the last camera
        self._chosen: dict[tuple, str] = {}
        self._report: Report = lambda text, share: None
        self._doing = ""  # begins each text of a report

    def steps(self, request: Request, report: Report) -> Iterator[Shown]:
        """Yield answers to a request as they get more complete: the picture, its cycles, its error
        against the model, its error against the scene. Raises InputError for a view that the
        machine cannot render."""
        self._report = report
        shot = self._shot(request)
        config = shot.config
        if request.layer == layers.RTL:
            yield self._simulated(shot)
            return
        quality = shot.packed and shot.packed.quality
        facts = {"preset": config.name, "quality": quality, "size": shot.size}
        facts |= {"layer": request.layer}
        machine = self._once(shot, "pixels", lambda: self._frame(shot).pixels)
        pictures = {layers.MACHINE: machine}
        yield Shown(pictures.get(request.layer), facts)
        report("counting cycles", None)
        facts |= {"cycles": self._cycles(shot)}
        if make := MAPS.get(request.layer):
            pictures[request.layer], facts["scale"] = make(config, self._frame(shot))
        yield Shown(pictures.get(request.layer), facts)
        for name, (layer, error) in TRUTHS.items():
            drawn = shot.reference if name == "machine" else self._truth(shot)
            if drawn is None:
                continue
            found = self._once(shot, name, lambda: difference(machine, drawn))  # noqa: B023
            facts = facts | against({name: found})
            pictures |= {layer: drawn, error: error_picture(machine, drawn)}
            yield Shown(pictures.get(request.layer), facts)
        if self.source.scene is None:  # the model stands for the scene
            for other, layer in zip(TRUTHS["scene"], TRUTHS["machine"], strict=True):
                pictures[other] = pictures[layer]
        yield Shown(pictures.get(request.layer), facts, done=True)

    def _shot(self, request: Request) -> Shot:
        """Return the request's frame, packed; forget the frames of another camera."""
        camera = request.camera
        key = tuple(
            np.asarray(value).tobytes() for value in vars(replace(camera, name="")).values()
        )
        if key not in list(self._views)[-1:]:
            self._frames.clear()
        self._kept = self._views[key] = self._views.pop(key, {})
        for old in list(self._views)[:-KEPT_CAMERAS]:
            del self._views[old]
        key = request.config, request.quality
        if key not in self._kept:
            shot = Shot(self.source, camera, *key, bar=self._bar)
            shot.check_fits()
            self._kept[key] = replace(shot, quality=self._quality(shot))
        return self._kept[key]

    def _quality(self, shot: Shot) -> str | None:
        """Return the quality of a scene, packed: chosen once per machine, in the first view."""
        key = packing_key(shot.config)
        if shot.source.scene is None:
            return shot.quality
        quality = shot.quality or self._chosen.get(key)
        if quality is None:
            self._report(CHOOSING, None)
            self._doing = f"{CHOOSING}: "
        self.packing = True
        try:
            found = replace(shot, quality=quality).packed.quality
            if quality is None:
                self._chosen[key] = found
        finally:
            self.packing, self._doing = False, ""
        return found

    @contextmanager
    def _bar(self, label: str) -> Iterator[Callable]:
        """Report the progress of a step to the current request."""

        def advance(done: int, total: int | None, text: str = label):
            self._report(self._doing + text, done / total if total else None)

        yield advance

    def _once(self, shot: Shot, name: str, make: Callable):
        """Return the kept value of a camera; make it if there is none."""
        key = name, shot.config, shot.quality
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _frame(self, shot: Shot) -> pipeline.Frame:
        """Return the golden model's frame of the last camera."""
        key = shot.config, shot.quality
        if key not in self._frames:
            self._frames[key] = engines.golden(shot)
        return self._frames[key]

    def _truth(self, shot: Shot) -> np.ndarray | None:
        """Return the reference's picture of the scene, the same for all machines."""
        if "scene" not in self._kept:
            self._kept["scene"] = shot.truth
        return self._kept["scene"]

    def _cycles(self, shot: Shot) -> dict:
        """Return cycles by stage, frames per second, and the limiting half and stage."""
        from splatcore.sim.cycles.frame import frame_cycles

        found = self._once(shot, "cycles", lambda: frame_cycles(shot.config, self._frame(shot)))
        half, stage = found.binding
        fps = round(CLOCK_HZ / found.frame, 1)
        return found.by_name | {"fps": fps, "half": half, "stage": stage}

    def _simulated(self, shot: Shot) -> Shown:
        """Simulate the hardware; return its picture and the comparison with the golden model."""
        from splatcore.sim.machine.diagnosis import diagnose
        from splatcore.sim.machine.machine import Machine
        from splatcore.sim.machine.script import LPDDR4

        config, report = shot.config, self._report
        frame = self._frame(shot)
        report(f"building the machine {config.name}, which takes minutes the first time", None)
        machine = Machine(config)

        def advance(cycles: int, written: int, total: int):
            report(f"simulating: {cycles:,} cycles", written / total)

        advance(0, 0, 1)
        run = machine.run([shot.job], LPDDR4, advance)
        if not run.done:
            return Shown(None, {"rtl": f"the machine failed: {run.why}"}, done=True)
        found = diagnose(config, run, 0, frame)
        cycles = max(run.preprocessing_cycles[0], run.rendering_cycles[0])
        facts = {"rtl": found or "identical to the golden model", "rtl_cycles": cycles}
        return Shown(run.frames[0].pixels, facts | {"quality": shot.quality}, done=True)


MAPS = {layers.TILES: layers.tile_picture, layers.GROUPS: layers.group_picture}

TRUTHS = {
    "machine": (layers.MODEL, layers.ERROR_MODEL),
    "scene": (layers.SCENE, layers.ERROR_SCENE),
}
"""Comparisons of the machine's picture: the layers of the exact picture and of the error map."""
