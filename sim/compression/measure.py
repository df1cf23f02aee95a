"""Quality of what compression leaves, the machine's work on it and its error, each measured once.

A measurement is a file under a key that stands for all that decides on it: the view, what is
rendered, and the code of all that this file imports.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from splatcore.golden import pipeline
from splatcore.golden.reference import render
from splatcore.model.compress.checkpoint import Step
from splatcore.model.pack.pack import pack
from splatcore.sim.common.metric import difference, flip, lpips
from splatcore.sim.common.output import progress_bar, write
from splatcore.sim.common.sources import code_key
from splatcore.sim.compression.run import Run
from splatcore.sim.compression.subjects import Subject, View
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene

LEAST, MOST = "psnr_db_min", ("max_error",)
"""The worst view's PSNR beside the mean, and what is the largest of all views."""


def kept(folder: Path, about: list, make: Callable[[], dict]) -> dict:
    """What `make` gives, made only if it is not in the folder. about: what decides on it (JSON)."""
    key = hashlib.sha256(json.dumps([code_key(kept), about]).encode()).hexdigest()
    path = folder / f"{key[:24]}.json"
    try:
        return json.loads(path.read_text())["result"]
    except (OSError, ValueError, KeyError, TypeError):
        result = make()  # not there, cut off, or none of ours
    folder.mkdir(parents=True, exist_ok=True)
    write(path, json.dumps({"about": about, "result": result}, indent=1).encode())
    return result


@dataclass(frozen=True, eq=False)
class Thing:
    """A scene or packed model that is loaded when it is needed. about: stands for it (JSON)."""

    name: str
    about: list
    load: Callable[[], Scene | PackedModel]

    @cached_property
    def loaded(self) -> Scene | PackedModel:
        return self.load()

    @cached_property
    def gaussians(self) -> Gaussians:
        return self.loaded.gaussians()

    def model(self, config: Config) -> PackedModel:
        """As the machine has it: a scene is packed."""
        return self.loaded if isinstance(self.loaded, PackedModel) else self._packed(config)

    def _packed(self, config: Config) -> PackedModel:
        if "packed" not in self.__dict__:
            self.__dict__["packed"] = pack(self.loaded, config)[0]
        return self.__dict__["packed"]


def original(subject: Subject) -> Thing:
    """The subject itself."""
    return Thing("original", [subject.key, "original"], lambda: subject.scene)


def left_by(run: Run, step: Step) -> Thing:
    """What a step left. Its seconds and loss, with all their digits, tell runs of the same key
    apart: one that was removed and made anew is measured anew."""
    if step.kind == "original":
        return original(run.subject)
    checkpoints = run.checkpoints
    load = checkpoints.model if step.kind == "quantize" else checkpoints.scene
    return Thing(step.name, [run.key, asdict(step)], lambda: load(step))


@dataclass(frozen=True, eq=False)
class Measurer:
    """Measures things on a subject's held-out views, means over these; keeps each in a folder."""

    folder: Path
    subject: Subject
    config: Config

    def quality(self, thing: Thing) -> dict:
        """`psnr_db` (None: equal), `ssim`, `flip`, `lpips`, `max_error` of the reference's 8-bit
        picture against the truth."""

        def one(view: View) -> dict:
            truth = self.subject.truth(view)
            if thing.name == "original" and not self.subject.photographed:
                return compared(truth, truth)
            return compared(render(thing.gaussians, view.camera).pixels, truth)

        return self._mean("quality", thing, one)

    def work(self, thing: Thing) -> dict:
        """The work that the machine has with it: counts of the golden engine, cycles by model."""

        def one(view: View) -> dict:
            frame = pipeline.render(self.config, thing.model(self.config), view.camera)
            cycles = frame_cycles(self.config, frame)
            halves = {"preprocessing": cycles.preprocessing, "rendering": cycles.rendering}
            counts = {name: frame.counts[name] for name in ("splats", "tile_pairs", "pairs")}
            return counts | {"cycles": cycles.frame} | halves

        found = self._mean("work", thing, one)
        return found | {"fps_at_800mhz": CLOCK_HZ / found["cycles"]}

    def budget(self, thing: Thing) -> dict:
        """Errors of a packed model: `model` (its exact picture against the truth), `machine` (the
        golden engine's against the exact one), `both` (the golden engine's against the truth)."""

        def one(view: View) -> dict:
            truth, model = self.subject.truth(view), thing.model(self.config)
            exact = render(model.gaussians(), view.camera).pixels
            machine = pipeline.render(self.config, model, view.camera).pixels
            pairs = {"model": (exact, truth), "machine": (machine, exact), "both": (machine, truth)}
            return {
                f"{name} {metric}": value
                for name, (image, reference) in pairs.items()
                for metric, value in asdict(difference(image, reference)).items()
            }

        found = self._mean("budget", thing, one)
        parts: dict[str, dict] = {"model": {}, "machine": {}, "both": {}}
        for name, value in found.items():
            part, metric = name.split(" ")
            parts[part][metric] = value
        return parts

    def _mean(self, kind: str, thing: Thing, one: Callable[[View], dict]) -> dict:
        """Means of what `one` says of each view."""
        rows = []
        for view in self.subject.views:
            about = [kind, self.subject.key, view.about, repr(self.config), thing.about]
            with progress_bar(f"{self.subject.name}: {kind} of {thing.name}, view {view.name}"):
                rows.append(kept(self.folder, about, lambda view=view: one(view)))
        return mean(rows)


def compared(picture: np.ndarray, truth: np.ndarray) -> dict:
    """All metrics of an 8-bit picture [H, W, 3] against what it should be."""
    found = asdict(difference(picture, truth))
    return found | {"flip": flip(picture, truth), "lpips": lpips(picture, truth)}


def mean(rows: list[dict]) -> dict:
    """Of each number its mean over the views that have it (None: no view has), of `max_error` the
    largest, and of PSNR also the least."""
    found = {}
    for name in rows[0]:
        values = [row[name] for row in rows if row[name] is not None]
        largest = name.split(" ")[-1] in MOST
        found[name] = (max(values) if largest else float(np.mean(values))) if values else None
        if name.endswith("psnr_db"):
            found[name.replace("psnr_db", LEAST)] = min(values, default=None)
    return found
