"""Quality of what compression leaves, the machine's work on it and its error, each measured once.

A measurement is a file under a key that stands for all that decides on it: the view, what is
rendered, and the code of all that this file imports.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from splatcore.golden import pipeline
from splatcore.golden.reference import render
from splatcore.model.compress.checkpoint import Step
from splatcore.model.formats.photographs import Target
from splatcore.model.pack.pack import pack
from splatcore.sim.common.cache import digest, kept_in
from splatcore.sim.common.metric import difference, flip, lpips
from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.sources import code_key
from splatcore.sim.compression.run import Run
from splatcore.sim.compression.subjects import Subject
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene


def kept(folder: Path, about: list, make: Callable[[], dict]) -> dict:
    """The result of `make`, made only if it is not in the folder. about: all that decides on it
    (see `digest`)."""
    return kept_in(folder / f"{digest([code_key(kept), about])[:24]}.json", make)


@dataclass(frozen=True, eq=False)
class Version:
    """A version of a subject: a scene or packed model that is loaded when it is needed. about:
    stands for it (JSON)."""

    name: str
    about: list
    config: Config
    load: Callable[[], Scene | PackedModel]

    @cached_property
    def loaded(self) -> Scene | PackedModel:
        return self.load()

    @cached_property
    def gaussians(self) -> Gaussians:
        return self.loaded.gaussians()

    @cached_property
    def model(self) -> PackedModel:
        """As the machine has it: a scene is packed, and `work` is the same in every quality."""
        loaded = self.loaded
        return loaded if isinstance(loaded, PackedModel) else pack(loaded, self.config)[0]


def original(subject: Subject) -> Version:
    """The subject itself."""
    about = [subject.key, "original"]
    return Version("original", about, subject.protocol.config, lambda: subject.scene)


def left_by(run: Run, step: Step) -> Version:
    """The version that a step left. Its seconds and loss, with all their digits, tell runs of the
    same key apart: one that was removed and made anew is measured anew."""
    if step.kind == "original":
        return original(run.subject)
    about = [run.key, asdict(step)]
    return Version(step.name, about, run.config, lambda: run.checkpoints.load(step))


@dataclass(frozen=True, eq=False)
class Measurer:
    """Measures versions on a subject's held-out views, means over these; keeps each in a folder."""

    folder: Path
    subject: Subject
    config: Config

    def quality(self, version: Version) -> dict:
        """`psnr_db` (None: equal), `ssim`, `flip`, `lpips`, `max_error` of the reference's 8-bit
        picture against the truth."""

        def one(view: Target) -> dict:
            return compared(*self._pictures(version, view))

        return self._mean("quality", version, one)

    def beside(self, version: Version) -> dict:
        """PSNR in dB (None: equal) beside the path: `psnr_db_beside`, by the names of `BESIDE`, and
        `psnr_db_beside_mean`."""

        def one(view: Target) -> dict:
            return asdict(difference(*self._pictures(version, view)))

        found = {
            name: self._mean("beside", version, one, [view])
            for name, view in self.subject.beside.items()
        }
        by_name = {name: row["psnr_db"] for name, row in found.items()}
        return {
            "psnr_db_beside": by_name,
            "psnr_db_beside_mean": mean(list(found.values()))["psnr_db"],
        }

    def _pictures(self, version: Version, view: Target) -> tuple[np.ndarray, np.ndarray]:
        """The reference's picture of a version and what it should be; the original itself is the
        truth where there are no photographs, and is not rendered twice."""
        truth = self.subject.truth(view)
        if version.name == "original" and not self.subject.photographed:
            return truth, truth
        return render(version.gaussians, view.camera).pixels, truth

    def work(self, version: Version) -> dict:
        """The work that the machine has with it: counts of the golden engine, cycles by model."""

        def one(view: Target) -> dict:
            frame = pipeline.render(self.config, version.model, view.camera)
            cycles = frame_cycles(self.config, frame)
            halves = {"preprocessing": cycles.preprocessing, "rendering": cycles.rendering}
            counts = {name: frame.counts[name] for name in ("splats", "tile_pairs", "pairs")}
            return counts | {"cycles": cycles.frame} | halves

        found = self._mean("work", version, one)
        return found | {"fps_at_800mhz": CLOCK_HZ / found["cycles"]}

    def budget(self, version: Version) -> dict:
        """Errors of a packed model: `model` (its exact picture against the truth), `machine` (the
        golden engine's against the exact one), `both` (the golden engine's against the truth)."""

        def one(view: Target) -> dict:
            truth, model = self.subject.truth(view), version.model
            exact = render(model.gaussians(), view.camera).pixels
            machine = pipeline.render(self.config, model, view.camera).pixels
            pairs = {"model": (exact, truth), "machine": (machine, exact), "both": (machine, truth)}
            return {name: asdict(difference(*images)) for name, images in pairs.items()}

        return self._mean("budget", version, one)

    def _mean(
        self,
        kind: str,
        version: Version,
        one: Callable[[Target], dict],
        views: Sequence[Target] | None = None,
    ) -> dict:
        """The mean over views, the held-out ones unless others are named, of the results of
        `one`."""
        rows = []
        for view in views or self.subject.views:
            about = [kind, self.subject.key, view.name, view.camera, repr(self.config)]
            with progress_bar(f"{self.subject.name}: {kind} of {version.name}, view {view.name}"):
                rows.append(kept(self.folder, [*about, version.about], lambda view=view: one(view)))
        return mean(rows)


def compared(picture: np.ndarray, truth: np.ndarray) -> dict:
    """All metrics of an 8-bit picture [H, W, 3] against what it should be."""
    found = asdict(difference(picture, truth))
    return found | {"flip": flip(picture, truth), "lpips": lpips(picture, truth)}


def mean(rows: list[dict]) -> dict:
    """Of each number its mean over the views that have it (None: no view has), of `max_error` the
    largest, and of PSNR also the least; rows may hold rows."""
    found = {}
    for name in rows[0]:
        values = [row[name] for row in rows if row[name] is not None]
        if isinstance(rows[0][name], dict):
            found[name] = mean(values)
            continue
        total = max if name == "max_error" else lambda values: float(np.mean(values))
        found[name] = total(values) if values else None
        if name == "psnr_db":
            found["psnr_db_min"] = min(values, default=None)
    return found
