"""Pictures and numbers of a scene, on request: golden model, reference, error maps, RTL."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from splatcore.app.view import layers
from splatcore.golden import pipeline, reference
from splatcore.model.pack.pack import pack, packing_key
from splatcore.sim.frame.metric import against, difference
from splatcore.sim.frame.picture import error_picture
from splatcore.sim.frame.source import Source, check_fits
from splatcore.spec.camera import Camera
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.packed import PackedModel

Report = Callable[[str, float | None], None]
"""Progress callback, called with the current step and the share done (0 … 1; None: unknown). An
exception that it raises aborts the work."""

GOLDEN = "rendering by the golden model"


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
    """A source with its packed models, by machine and quality, and the last camera's pictures."""

    def __init__(self, source: Source):
        self.source = source
        self._models: dict[tuple, tuple[PackedModel, str | None]] = {}
        self._kept: dict[tuple, object] = {}
        self._camera: tuple = ()

    def steps(self, request: Request, report: Report) -> Iterator[Shown]:
        """Yield answers to a request as they get more complete: the picture, its error against the
        model, its error against the scene. Raises InputError for a view that the machine cannot
        render."""
        camera, config = request.camera, request.config
        check_fits(config, camera.width, camera.height)
        self._begin(camera)
        if request.layer == layers.RTL:
            yield self._simulated(request, report)
            return
        _, quality, frame = self._rendered(request, report)
        facts = {"preset": config.name, "quality": quality, "size": (camera.width, camera.height)}
        facts |= {"cycles": self._cycles(config, quality, frame), "layer": request.layer}
        pictures = {layers.MACHINE: frame.pixels}
        for layer, make in MAPS.items():
            if request.layer == layer:
                pictures[layer], facts["scale"] = make(config, frame)
        yield Shown(pictures.get(request.layer), facts)
        for truth, (layer, error) in TRUTHS.items():
            drawn = self._drawn(truth, request, report)
            if drawn is None:
                continue
            key = "difference", truth, config, quality
            found = self._once(key, lambda: difference(frame.pixels, drawn))  # noqa: B023
            facts = facts | against({truth: found})
            pictures |= {layer: drawn, error: error_picture(frame.pixels, drawn)}
            yield Shown(pictures.get(request.layer), facts)
        if self.source.scene is None:  # the model stands for the scene
            for other, layer in zip(TRUTHS["scene"], TRUTHS["machine"], strict=True):
                pictures[other] = pictures[layer]
        yield Shown(pictures.get(request.layer), facts, done=True)

    def _begin(self, camera: Camera):
        """Forget the last camera's pictures if this is another."""
        key = tuple(np.asarray(value).tobytes() for value in list(vars(camera).values())[:-1])
        if key != self._camera:
            self._camera = key
            self._kept.clear()

    def _once(self, key: tuple, make: Callable):
        """Return the kept value of a key; make it if there is none."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _model(self, request: Request, report: Report) -> tuple[PackedModel, str | None]:
        """Return the model and its quality (None: the source is packed); pack a scene once per
        machine and quality."""
        if self.source.scene is None:
            return self.source.model, None
        key = packing_key(request.config), request.quality
        if key not in self._models:
            quality = request.quality
            if quality is None:
                from splatcore.sim.frame.choose import quality_of

                report("choosing a quality", None)
                quality = quality_of(self.source, request.config, [request.camera])
            report(f"packing: {quality}", None)
            made = pack(self.source.scene, request.config, quality=quality)[0], quality
            self._models[key] = self._models[key[0], quality] = made
        return self._models[key]

    def _rendered(
        self, request: Request, report: Report
    ) -> tuple[PackedModel, str | None, pipeline.Frame]:
        """Return model, quality and the golden model's frame, with a black background."""
        model, quality = self._model(request, report)

        def step(name: str):
            report(f"{GOLDEN}: {name}", pipeline.STEPS.index(name) / len(pipeline.STEPS))

        def make():
            return pipeline.render(request.config, model, request.camera, progress=step)

        return model, quality, self._once(("golden", request.config, quality), make)

    def _cycles(self, config: Config, quality: str | None, frame: pipeline.Frame) -> dict:
        """Return cycles by stage, frames per second, and the limiting half and stage."""
        from splatcore.sim.cycles.frame import frame_cycles

        found = self._once(("cycles", config, quality), lambda: frame_cycles(config, frame))
        half, stage = found.binding
        fps = round(CLOCK_HZ / found.frame, 1)
        return found.by_name | {"fps": fps, "half": half, "stage": stage}

    def _drawn(self, truth: str, request: Request, report: Report) -> np.ndarray | None:
        """Return the reference's picture of the model ("machine") or the original scene ("scene");
        None if the source has no scene."""
        model, quality = self._model(request, report)
        if truth == "scene" and self.source.scene is None:
            return None
        key = ("machine", request.config, quality) if truth == "machine" else ("scene",)

        def make():
            shown = model.gaussians() if truth == "machine" else self.source.gaussians
            label = f"rendering the {'model' if truth == 'machine' else truth} by the reference"
            report(label, 0.0)
            return reference.render(
                shown, request.camera, progress=lambda done, total: report(label, done / total)
            ).pixels

        return self._once(key, make)

    def _simulated(self, request: Request, report: Report) -> Shown:
        """Simulate the hardware; return its picture and the comparison with the golden model."""
        from splatcore.sim.machine.diagnosis import diagnose
        from splatcore.sim.machine.machine import Job, Machine
        from splatcore.sim.machine.script import LPDDR4

        config = request.config
        model, quality, frame = self._rendered(request, report)
        report(f"building the machine {config.name}, which takes minutes the first time", None)
        machine = Machine(config)

        def advance(cycles: int, written: int, total: int):
            report(f"simulating: {cycles:,} cycles", written / total)

        advance(0, 0, 1)
        run = machine.run([Job(model, request.camera)], LPDDR4, advance)
        if not run.done:
            return Shown(None, {"rtl": f"the machine failed: {run.why}"}, done=True)
        found = diagnose(config, run, 0, frame)
        cycles = max(run.preprocessing_cycles[0], run.rendering_cycles[0])
        facts = {"rtl": found or "identical to the golden model", "rtl_cycles": cycles}
        return Shown(run.frames[0].pixels, facts | {"quality": quality}, done=True)


MAPS = {layers.TILES: layers.tile_picture, layers.GROUPS: layers.group_picture}

TRUTHS = {
    "machine": (layers.MODEL, layers.ERROR_MODEL),
    "scene": (layers.SCENE, layers.ERROR_SCENE),
}
"""Comparisons of the machine's picture: the layers of the exact picture and of the error map."""
