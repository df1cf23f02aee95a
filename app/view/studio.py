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


class Studio:
    """A source and the frames of the last camera, by machine and quality."""

    def __init__(self, source: Source):
        self.source = source
        self._shots: dict[tuple, Shot] = {}
        self._chosen: dict[tuple, str] = {}
        self._kept: dict[object, object] = {}
        self._camera: tuple = ()
        self._report: Report = lambda text, share: None

    def steps(self, request: Request, report: Report) -> Iterator[Shown]:
        """Yield answers to a request as they get more complete: the picture, its error against the
        model, its error against the scene. Raises InputError for a view that the machine cannot
        render."""
        self._report = report
        shot = self._shot(request)
        config = shot.config
        if request.layer == layers.RTL:
            yield self._simulated(shot)
            return
        frame = self._once(shot, "golden", lambda: engines.golden(shot))
        quality = shot.packed and shot.packed.quality
        facts = {"preset": config.name, "quality": quality, "size": shot.size}
        facts |= {"cycles": self._cycles(shot, frame), "layer": request.layer}
        pictures = {layers.MACHINE: frame.pixels}
        for layer, make in MAPS.items():
            if request.layer == layer:
                pictures[layer], facts["scale"] = make(config, frame)
        yield Shown(pictures.get(request.layer), facts)
        for name, (layer, error) in TRUTHS.items():
            drawn = shot.reference if name == "machine" else self._truth(shot)
            if drawn is None:
                continue
            found = self._once(shot, name, lambda: difference(frame.pixels, drawn))  # noqa: B023
            facts = facts | against({name: found})
            pictures |= {layer: drawn, error: error_picture(frame.pixels, drawn)}
            yield Shown(pictures.get(request.layer), facts)
        if self.source.scene is None:  # the model stands for the scene
            for other, layer in zip(TRUTHS["scene"], TRUTHS["machine"], strict=True):
                pictures[other] = pictures[layer]
        yield Shown(pictures.get(request.layer), facts, done=True)

    def _shot(self, request: Request) -> Shot:
        """Return the request's frame, packed; forget those of another camera."""
        camera = request.camera
        key = tuple(np.asarray(value).tobytes() for value in list(vars(camera).values())[:-1])
        if key != self._camera:
            self._camera = key
            self._shots.clear(), self._kept.clear()
        key = request.config, request.quality
        if key not in self._shots:
            shot = Shot(self.source, camera, *key, bar=self._bar)
            shot.check_fits()
            self._shots[key] = replace(shot, quality=self._quality(shot))
        return self._shots[key]

    def _quality(self, shot: Shot) -> str | None:
        """Return the quality to pack a scene in: chosen once per machine, in the first view."""
        key = packing_key(shot.config)
        if shot.source.scene is None or shot.quality:
            return shot.quality
        if key not in self._chosen:
            self._chosen[key] = shot.packed.quality
        return self._chosen[key]

    @contextmanager
    def _bar(self, label: str) -> Iterator[Callable]:
        """Report the progress of a step to the current request."""

        def advance(done: int, total: int | None, text: str = label):
            self._report(text, done / total if total else None)

        yield advance

    def _once(self, shot: Shot, name: str, make: Callable):
        """Return the kept value of a frame; make it if there is none."""
        key = name, shot.config, shot.quality
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _truth(self, shot: Shot) -> np.ndarray | None:
        """Return the reference's picture of the scene, the same for all machines."""
        if "scene" not in self._kept:
            self._kept["scene"] = shot.truth
        return self._kept["scene"]

    def _cycles(self, shot: Shot, frame: pipeline.Frame) -> dict:
        """Return cycles by stage, frames per second, and the limiting half and stage."""
        from splatcore.sim.cycles.frame import frame_cycles

        found = self._once(shot, "cycles", lambda: frame_cycles(shot.config, frame))
        half, stage = found.binding
        fps = round(CLOCK_HZ / found.frame, 1)
        return found.by_name | {"fps": fps, "half": half, "stage": stage}

    def _simulated(self, shot: Shot) -> Shown:
        """Simulate the hardware; return its picture and the comparison with the golden model."""
        from splatcore.sim.machine.diagnosis import diagnose
        from splatcore.sim.machine.machine import Machine
        from splatcore.sim.machine.script import LPDDR4

        config, report = shot.config, self._report
        frame = self._once(shot, "golden", lambda: engines.golden(shot))
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
