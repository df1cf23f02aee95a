"""`splatcore bench compression`: the paper's tables of compression, and what it leaves to do.

Four parts: quality and work after each step, pruning schedules, ratio against loss, and the errors
of model and machine side by side. What is in the folder already is not made again.
"""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from splatcore.model.compress.checkpoint import Step
from splatcore.model.compress.recipe import Recipe
from splatcore.model.pack.pack import pack
from splatcore.sim.bench.campaign import Failure
from splatcore.sim.common.output import messages
from splatcore.sim.common.result import write_json
from splatcore.sim.compression.measure import Measurer, Thing, kept, left_by, original
from splatcore.sim.compression.plot import write_sheet
from splatcore.sim.compression.run import Run, recipe_of
from splatcore.sim.compression.subjects import Protocol, Subject
from splatcore.spec.error import InputError

PARTS = ("steps", "schedule", "curve", "budget")

RESULT = "compression.json"

RATIOS = (10, 15, 20, 30, 40, 51.6, 75, 100)

ONE_STEP = 0.5
"""A schedule of one pruning; its rate is what the ratio asks for."""

SHORT_OF = 0.98
"""Share of a target ratio from which it counts as reached."""

DEFAULT_SCHEDULE = (0.4, 0.4, 0.4, 0.2)


def left(schedule: tuple[float, ...]) -> float:
    """Share of the Gaussians that a schedule leaves."""
    share = 1.0
    for rate in schedule:
        share *= 1 - rate
    return share


def equal_rates(count: int, schedule: tuple[float, ...] = DEFAULT_SCHEDULE) -> tuple[float, ...]:
    """So many equal rates that leave what a schedule leaves."""
    return (round(1 - left(schedule) ** (1 / count), 6),) * count


SCHEDULES = (
    DEFAULT_SCHEDULE, equal_rates(1), (0.4, 0.4, 0.4, 0.4), (0.4, 0.4, 0.4, 0.3),
    (0.4, 0.4, 0.4, 0.1), equal_rates(5),
)  # fmt: skip
"""Compared with each other; the second and the last leave what the first one leaves."""


@dataclass(frozen=True)
class Request:
    """What is to be measured."""

    subjects: tuple[str, ...]  # paths
    parts: tuple[str, ...]
    schedule_scene: str  # the name of the one whose schedules are compared
    ratios: tuple[float, ...]
    protocol: Protocol


class Bench:
    """One subject's parts."""

    def __init__(self, subject: Subject, request: Request, folder: Path):
        self.subject, self.request, self.folder = subject, request, folder
        self.protocol = request.protocol
        self.recipe = recipe_of(*self.protocol.options)
        self.measure = Measurer(folder / "measured", subject, self.protocol.config)

    def facts(self) -> dict:
        """What the subject is."""
        subject, first = self.subject, self.subject.views[0].camera
        return {
            "against": "photographs" if subject.photographed else "original",
            "views": len(subject.views), "size": [first.width, first.height],
            "gaussians": len(subject.scene), "sh_degree": subject.scene.sh_degree,
            "ply_bytes": subject.ply_bytes,
        }  # fmt: skip

    def run(self, recipe: Recipe) -> Run:
        return Run(self.folder / "runs", self.subject, recipe, self.protocol.config)

    def row(self, thing: Thing, step: Step) -> dict:
        """A step's size and quality, and how that differs from the original's."""
        first, found = self.measure.quality(original(self.subject)), self.measure.quality(thing)
        change = {
            f"{name}_change": None if None in (found[name], first[name]) else
            found[name] - first[name]
            for name in ("psnr_db", "ssim", "flip", "lpips")
        }  # fmt: skip
        size = {"bytes": step.bytes, "ratio": self.subject.ply_bytes / step.bytes}
        return {"gaussians": step.gaussians, "sh_degree": step.sh_degree} | size | found | change

    def steps(self) -> dict:
        """Every step of the recipe: size, quality, the machine's work."""
        run, rows = self.run(self.recipe), []
        final = run.finish()
        for step in run.checkpoints.steps:
            thing = left_by(run, step)
            about = {"step": step.name, "kind": step.kind, "seconds": step.seconds}
            about |= {"loss": step.loss}
            rows.append(about | self.row(thing, step) | {"work": self.measure.work(thing)})
        self.sheet(left_by(run, final), rows[-1])
        return {"recipe": asdict(self.recipe), "rows": rows}

    def sheet(self, thing: Thing, row: dict):
        """Original, compressed and FLIP of the first held-out view, as DIR/NAME.png."""
        path = self.folder / f"{self.subject.name}.png"
        view, about = self.subject.views[0], ["sheet", self.subject.key, thing.about]

        def make() -> dict:
            write_sheet(path, self.subject, view, thing, row)
            return {"file": path.name}

        if not path.exists():
            make()
        kept(self.folder / "measured", about, make)

    def schedule(self) -> dict:
        """Pruning schedules with the same number of fine-tuning steps in all."""
        total = self.recipe.steps * len(self.recipe.schedule)
        rows = []
        for schedule in SCHEDULES:
            steps = round(total / len(schedule))
            run = self.run(replace(self.recipe, schedule=schedule, steps=steps))
            step = run.prune()
            before = run.before(step).gaussians
            rows.append(
                {"schedule": list(schedule), "steps": steps, "gaussians_before": before}
                | self.row(left_by(run, step), step)
            )
            if run.recipe != self.recipe:
                run.slim()
        first = self.measure.quality(original(self.subject))
        return {"steps_in_all": total, "rows": rows, "original": first}

    def curve(self) -> dict:
        """Quality by ratio; what packing alone gives comes first.

        Each point prunes the original in one step, which costs a quarter of the default schedule.
        """
        config, subject = self.protocol.config, self.subject

        def alone() -> dict:
            model = pack(subject.scene, config)[0]
            facts = {"gaussians": len(model), "sh_degree": model.format.sh_degree}
            return facts | {"bytes": len(model.image)}

        about = ["packing alone", subject.key, repr(config)]
        facts = kept(self.folder / "measured", about, alone)
        packed = Step("packing alone", "quantize", **facts, seconds=0.0, loss=None)
        thing = Thing(packed.name, about, lambda: pack(subject.scene, config)[0])
        first = {"target_ratio": None, "note": packed.name} | self.row(thing, packed)
        points = [first]
        for ratio in sorted(self.request.ratios):
            if ratio <= first["ratio"]:
                note = f"packing alone gives {first['ratio']:.1f}×"
                points.append({"target_ratio": ratio, "ratio": None, "note": note})
            else:
                recipe = replace(self.recipe, schedule=(ONE_STEP,), target_ratio=ratio)
                points.append(self.point(self.run(recipe), ratio))
        return {"recipe": asdict(self.recipe), "points": points}

    def point(self, run: Run, ratio: float) -> dict:
        """A compression to a ratio; `note` says so if it is not reached."""
        try:
            step = run.finish()
        except InputError as error:
            if "target-ratio" not in str(error):
                raise
            return {"target_ratio": ratio, "ratio": None, "note": str(error)}
        point = {"target_ratio": ratio, "note": ""} | self.row(left_by(run, step), step)
        if point["ratio"] < SHORT_OF * ratio:
            point["note"] = f"only {point['ratio']:.1f}× was reached"
        run.slim()
        return point

    def budget(self) -> dict:
        """Errors of the model and of the machine side by side."""
        run = self.run(self.recipe)
        return self.measure.budget(left_by(run, run.finish()))


def bench_compression(request: Request, folder: Path) -> dict:
    """Measure all subjects; what cannot be is in "failed", and the others' results stay.

    RESULT is written after each part, for who looks in meanwhile.
    """
    facts = before(request, folder)
    for path in request.subjects:
        subject = Subject(path, request.protocol, folder / "baselines")
        bench = Bench(subject, request, folder)
        for part in request.parts:
            if part == "schedule" and subject.name != request.schedule_scene:
                continue
            try:
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
    """An error in a line."""
    if isinstance(error, MemoryError):
        return "memory exhausted"
    text = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())


def before(request: Request, folder: Path) -> dict:
    """The folder's results of scenes and parts that are not asked for now stay as they are."""
    protocol = request.protocol
    head = {"preset": protocol.config.name, "size": list(protocol.size), "seed": protocol.seed}
    try:
        found = json.loads((folder / RESULT).read_text())
        same = all(found[name] == value for name, value in head.items())
        scenes = found["scenes"] if same else {}
    except (OSError, ValueError, KeyError, TypeError):
        scenes = {}
    return head | {"scenes": scenes, "failed": []}
