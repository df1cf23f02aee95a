"""Measurements of compressed versions: quality, the machine's work and its error.

Each measurement is a file, stored with a key of everything that it depends on: the view, the
version, and the code of all modules that this file imports.
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
from splatcore.sim.common.cache import kept_in
from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.sources import code_key
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.metric import difference, flip, lpips
from splatcore.spec.cache import digest
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene
from splatcore.study.compression.run import Run
from splatcore.study.compression.subjects import Subject


def kept(folder: Path, about: list, make: Callable[[], dict]) -> dict:
    """Return the result of `make`, from the folder if possible.

    about: everything that the result depends on, for `digest`
    """
    return kept_in(folder / f"{digest([code_key(kept), about])[:24]}.json", make)


@dataclass(frozen=True, eq=False)
class Version:
    """A version of a subject: a scene or packed model, loaded on demand. about: its key (JSON)."""

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
        """The packed model; a scene is packed, in any quality, as `work` does not depend on it."""
        loaded = self.loaded
        return loaded if isinstance(loaded, PackedModel) else pack(loaded, self.config)[0]


def original(subject: Subject) -> Version:
    """The subject itself as a version."""
    about = [subject.key, "original"]
    return Version("original", about, subject.protocol.config, lambda: subject.scene)


def left_by(run: Run, step: Step) -> Version:
    """The version after a step.

    Its key includes the step's seconds and loss, so a repeated run is measured again.
    """
    if step.kind == "original":
        return original(run.subject)
    about = [run.key, asdict(step)]
    return Version(step.name, about, run.config, lambda: run.checkpoints.load(step))


@dataclass(frozen=True, eq=False)
class Measurer:
    """Measure versions on a subject's held-out views and average; keep each result in a folder."""

    folder: Path
    subject: Subject
    config: Config

    def quality(self, version: Version) -> dict:
        """Metrics of the reference's 8-bit pictures against the truth, as in `compared`."""

        def one(view: Target) -> dict:
            return compared(*self._pictures(version, view))

        return self._mean("quality", version, one)

    def beside(self, version: Version) -> dict:
        """PSNR in dB (None: equal) in views off the path.

        Returns `psnr_db_beside`, by the names of `BESIDE`, and `psnr_db_beside_mean`.
        """

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
        """The reference's picture of a version, and the truth.

        Without photographs the original is the truth, and is rendered only once.
        """
        truth = self.subject.truth(view)
        if version.name == "original" and not self.subject.photographed:
            return truth, truth
        return render(version.gaussians, view.camera).pixels, truth

    def work(self, version: Version) -> dict:
        """The machine's work on a version: golden model's counts, cycle model's cycles."""

        def one(view: Target) -> dict:
            frame = pipeline.render(self.config, version.model, view.camera)
            cycles = frame_cycles(self.config, frame)
            halves = {"preprocessing": cycles.preprocessing, "rendering": cycles.rendering}
            counts = {name: frame.counts[name] for name in ("splats", "tile_pairs", "pairs")}
            return counts | {"cycles": cycles.frame} | halves

        found = self._mean("work", version, one)
        return found | {"fps_at_800mhz": CLOCK_HZ / found["cycles"]}

    def budget(self, version: Version) -> dict:
        """Errors of a packed model.

        model: the reference's picture against the truth
        machine: the golden model's picture against the reference's
        both: the golden model's picture against the truth
        """

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
        """The mean of `one` over views, by default the held-out ones."""
        rows = []
        for view in views or self.subject.views:
            about = [kind, self.subject.key, view.name, view.camera, repr(self.config)]
            with progress_bar(f"{self.subject.name}: {kind} of {version.name}, view {view.name}"):
                rows.append(kept(self.folder, [*about, version.about], lambda view=view: one(view)))
        return mean(rows)


def compared(picture: np.ndarray, truth: np.ndarray) -> dict:
    """Compare 8-bit pictures [H, W, 3]: psnr_db (None: equal), ssim, max_error, flip, lpips."""
    found = asdict(difference(picture, truth))
    return found | {"flip": flip(picture, truth), "lpips": lpips(picture, truth)}


def mean(rows: list[dict]) -> dict:
    """Average each number over the views that have it; None if none has.

    `max_error` is the maximum instead, and `psnr_db_min` is added. Rows may contain rows.
    """
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
