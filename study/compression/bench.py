"""The benchmark of compression: the paper's tables, and the machine's work on compressed models.

Parts: quality and work after each step, pruning schedules, ratio against loss, errors of model and
machine, and power after each step. Results that are already in the folder are reused.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from math import prod
from pathlib import Path

from splatcore.eda.cells.liberty import Library
from splatcore.model.compress.checkpoint import Step
from splatcore.model.compress.recipe import Recipe
from splatcore.model.pack.pack import pack
from splatcore.sim.common.output import messages, write_json
from splatcore.spec.error import InputError
from splatcore.study.bench.campaign import Failure
from splatcore.study.compression.measure import Measurer, Version, kept, left_by, original
from splatcore.study.compression.plot import write_sheet
from splatcore.study.compression.run import Run
from splatcore.study.compression.subjects import Protocol, Subject

PARTS = ("steps", "schedule", "curve", "budget", "power")

BY_ITSELF = PARTS[:-1]
"""Parts that are measured by default: all that need no RTL."""

RESULT = "compression.json"

RATIOS = (10, 15, 20, 30, 40, 51.6, 75, 100)

SHORT_OF = 0.98  # minimum share of a target ratio that counts as reached


def left(schedule: Sequence[float]) -> float:
    """Share of the Gaussians that remain after a schedule."""
    return prod(1 - rate for rate in schedule)


def equal_rates(count: int, schedule: Sequence[float] = Recipe.schedule) -> tuple[float, ...]:
    """`count` equal rates that leave the same share of Gaussians as a schedule."""
    return (round(1 - left(schedule) ** (1 / count), 6),) * count


SCHEDULES = (
    Recipe.schedule, equal_rates(1), (0.4, 0.4, 0.4, 0.4), (0.4, 0.4, 0.4, 0.3),
    (0.4, 0.4, 0.4, 0.1), equal_rates(5),
)  # fmt: skip
"""Schedules to compare; the second and the last leave as many Gaussians as the first."""


class Bench:
    """The benchmark of one subject; methods named in `PARTS` measure its parts."""

    def __init__(
        self,
        subject: Subject,
        ratios: Sequence[float],
        folder: Path,
        cells: tuple[Library, float] | None,
    ):
        self.subject, self.ratios, self.folder, self.cells = subject, ratios, folder, cells
        self.config, self.recipe = subject.protocol.config, subject.protocol.recipe
        self.measure = Measurer(folder / "measured", subject, self.config)

    def facts(self) -> dict:
        """Properties of the subject: its truth, views and size."""
        subject, first = self.subject, self.subject.views[0].camera
        return {
            "against": "photographs" if subject.photographed else "original",
            "views": len(subject.views), "size": [first.width, first.height],
            "gaussians": len(subject.scene), "sh_degree": subject.scene.sh_degree,
            "ply_bytes": subject.ply_bytes,
        }  # fmt: skip

    def run(self, **changes) -> Run:
        """A run of the recipe with some values changed."""
        recipe = replace(self.recipe, **changes)
        return Run(self.folder / "runs", self.subject, recipe, self.config)

    def row(self, version: Version, step: Step) -> dict:
        """A step's size and quality, and the changes of quality from the original."""
        first, found = self.measure.quality(original(self.subject)), self.measure.quality(version)
        change = {
            f"{name}_change": None if None in (found[name], first[name]) else
            found[name] - first[name]
            for name in ("psnr_db", "ssim", "flip", "lpips")
        }  # fmt: skip
        size = {"bytes": step.bytes, "ratio": self.subject.ply_bytes / step.bytes}
        size["bytes_each"] = step.bytes / len(self.subject.scene)
        row = {"gaussians": step.gaussians, "sh_degree": step.sh_degree} | size | found | change
        return row | (self.measure.beside(version) if self.subject.beside else {})

    def worked(self, version: Version, step: Step) -> dict:
        """A step's `row` with the machine's work."""
        return self.row(version, step) | {"work": self.measure.work(version)}

    def steps(self) -> dict:
        """Size, quality and the machine's work after every step; writes the last step's sheet."""
        run, rows = self.run(), []
        run.finish()
        for step in run.checkpoints.steps:
            version = left_by(run, step)
            about = {"step": step.name, "kind": step.kind, "seconds": step.seconds}
            about |= {"loss": step.loss}
            rows.append(about | self.worked(version, step))
        self.sheet(version, rows[-1])
        return {"recipe": asdict(self.recipe), "rows": rows}

    def sheet(self, version: Version, row: dict):
        """Write DIR/NAME.png: truth, compressed model and FLIP map of the first held-out view."""
        path = self.folder / f"{self.subject.name}.png"

        def make() -> dict:
            write_sheet(path, self.subject, self.subject.views[0], version, row)
            return {"file": path.name}

        if not path.exists():
            make()
        kept(self.folder / "measured", ["sheet", self.subject.key, version.about], make)

    def schedule(self) -> dict:
        """Compare pruning schedules with the same total number of fine-tuning steps."""
        total, rows = self.recipe.steps * len(self.recipe.schedule), []
        for schedule in SCHEDULES:
            count = round(total / len(schedule))
            run = self.run(schedule=schedule, steps=count)
            step, steps = run.prune(), run.checkpoints.steps
            before = steps[steps.index(step) - 1].gaussians
            rows.append(
                {"schedule": list(schedule), "steps": count, "gaussians_before": before}
                | self.row(left_by(run, step), step)
            )
            if run.recipe != self.recipe:
                run.slim()
        first = self.measure.quality(original(self.subject))
        return {"steps_in_all": total, "rows": rows, "original": first}

    def curve(self) -> dict:
        """Quality and the machine's work by ratio, first for packing alone."""

        def alone():
            return pack(self.subject.scene, self.config, **self.recipe.packing)[0]

        def sizes() -> dict:
            model = alone()
            facts = {"gaussians": len(model), "sh_degree": model.format.sh_degree}
            return facts | {"bytes": len(model.image)}

        name, packing = "packing alone", self.recipe.packing
        about = [name, self.subject.key, repr(self.config), packing]
        facts = kept(self.folder / "measured", about, sizes)
        step = Step(name, "quantize", **facts, seconds=0.0, loss=None, file="")
        version = Version(name, about, self.config, alone)
        first = {"target_ratio": None, "note": name} | self.worked(version, step)
        points = [first]
        for ratio in sorted(self.ratios):
            if ratio <= first["ratio"]:
                note = f"packing alone gives {first['ratio']:.1f}×"
                points.append({"target_ratio": ratio, "ratio": None, "note": note})
            else:
                run = self.run(target_ratio=ratio)
                points.append(self.point(run, ratio))
        return {"recipe": asdict(self.recipe), "points": points}

    def point(self, run: Run, ratio: float) -> dict:
        """Compress to a ratio; `note` has a text if it is not reached."""
        try:
            step = run.finish()
        except InputError as error:
            if "target-ratio" not in str(error):
                raise
            return {"target_ratio": ratio, "ratio": None, "note": str(error)}
        point = {"target_ratio": ratio, "note": ""} | self.worked(left_by(run, step), step)
        if point["ratio"] < SHORT_OF * ratio:
            point["note"] = f"reached only {point['ratio']:.1f}×"
        run.slim()
        return point

    def budget(self) -> dict:
        """Errors of the model, of the machine and of both."""
        run = self.run()
        return self.measure.budget(left_by(run, run.finish()))

    def power(self) -> dict:
        """Estimated power of the first held-out view in RTL after each step."""
        from splatcore.study.compression.power import powers  # slow import

        run = self.run()
        run.finish()
        return powers(run, self.subject.views[0], self.cells)


def bench_compression(
    paths: Sequence[str],
    parts: Sequence[str],
    schedule_scene: str,
    ratios: Sequence[float],
    protocol: Protocol,
    folder: Path,
    cells: tuple[Library, float] | None = None,
) -> dict:
    """Measure parts of all subjects; failures are listed in "failed".

    paths: scene files or folders of photographs
    schedule_scene: name of the subject on which pruning schedules are compared
    ratios: target ratios of part "curve"
    cells: a library and its process in nm, to estimate power in its cells as well
    Writes RESULT after each part.
    """
    facts = before(protocol, folder)
    for path in paths:
        subject = Subject(path, protocol, folder / "baselines")
        bench = Bench(subject, ratios, folder, cells)
        for part in parts:
            if part == "schedule" and subject.name != schedule_scene:
                continue
            try:
                bench.recipe.check(subject.scene, protocol.config)
                found = bench.facts() | {part: getattr(bench, part)()}
            except Exception as error:
                facts["scenes"].get(subject.name, {}).pop(part, None)
                failure = Failure(f"{subject.name}: {part}", why(error))
                messages.print(f"{failure.what}: {failure.why}", markup=False, soft_wrap=True)
                facts["failed"].append(asdict(failure))
            else:
                facts["scenes"][subject.name] = facts["scenes"].get(subject.name, {}) | found
            write_json(folder / RESULT, facts)
    return facts


def why(error: Exception) -> str:
    """An error as one line."""
    if isinstance(error, MemoryError):
        return "out of memory"
    text = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())


def before(protocol: Protocol, folder: Path) -> dict:
    """Earlier results in the folder, kept if they were measured with the same options."""
    head = {"preset": protocol.config.name, "size": list(protocol.size)}
    head |= {name: getattr(protocol, name) for name in ("degree", "quality", "beside", "seed")}
    try:
        found = json.loads((folder / RESULT).read_text())
        same = all(found[name] == value for name, value in head.items())
        scenes = found["scenes"] if same else {}
    except (OSError, ValueError, KeyError, TypeError):
        scenes = {}
    return head | {"scenes": scenes, "failed": []}
