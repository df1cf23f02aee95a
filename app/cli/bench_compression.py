"""The command `bench compression`: the paper's measurements of compression."""

from dataclasses import dataclass
from pathlib import Path

from splatcore.app.cli.bench import PIXELS, finish
from splatcore.app.cli.compress import LEARN, TRAINING
from splatcore.app.cli.options import (
    KEPT_FOLDER,
    MACHINE,
    PRESET,
    argument,
    command,
    listed,
    option,
)
from splatcore.app.cli.power import LIBERTY, PROCESS, checked_library
from splatcore.eda.cells.liberty import Library
from splatcore.model.pack.quality import COMPACT, INDEXED, STEPPED
from splatcore.sim.common.choice import check_known, numbers
from splatcore.sim.common.output import make_folder
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.size import parse_size
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.error import InputError
from splatcore.study.compression import run as compression_run
from splatcore.study.compression.bench import BY_ITSELF, PARTS, RATIOS, RESULT, bench_compression
from splatcore.study.compression.plot import write_curve
from splatcore.study.compression.subjects import SCENES, Protocol, find
from splatcore.study.compression.tables import tables, write_csv

DEFAULTS = Protocol(DEFAULT)

ALL_PARTS, ALL_RATIOS = ",".join(BY_ITSELF), ",".join(f"{ratio:g}" for ratio in RATIOS)
VIEW_SIZE = "x".join(map(str, DEFAULTS.view_size))  # as on the command line


@dataclass(frozen=True)
class Learning(Reading):
    """The options of all subjects, as in `Protocol`."""

    steps: int | None = option(
        None,
        "N",
        "Fine-tuning steps after each pruning; other steps in proportion.",
        panel=TRAINING,
    )
    train_steps: int = option(
        DEFAULTS.train_steps, "N", "Steps to train a scene from photographs first.", panel=TRAINING
    )
    views: int = option(
        DEFAULTS.views, "N", "Pictures to learn from, of a scene without photographs.", panel=LEARN
    )
    view_size: str = option(VIEW_SIZE, "WxH", "Pixels of the pictures to learn from.", panel=LEARN)
    beside: float | None = option(
        DEFAULTS.beside,
        "S",
        "With --cameras: share of the views off the path, up to 15° aside, at 0.8 to 1.25 times "
        f"its distance. Default: {compression_run.BESIDE_SHARE:g}.",
        min=0,
        max=1,
        panel=LEARN,
    )
    size: str = PIXELS
    scale: float = option(
        DEFAULTS.scale, "S", "Shrink the photographs by this factor, 0 … 1.", panel=LEARN
    )
    rate: float = option(
        DEFAULTS.rate, "S", "Factor on the default learning rates.", panel=TRAINING
    )
    order: str = option(
        DEFAULTS.order, "ORDER", "distill-first, or prune-first as in the paper.", panel=TRAINING
    )
    degree: int | None = option(
        DEFAULTS.degree,
        "N",
        "Degree of the model's harmonics; from 2 on it is packed in steps. "
        "Default: chosen by trials.",
        min=0,
        max=3,
        panel=MACHINE,
    )
    quality: str | None = option(
        DEFAULTS.quality,
        "NAME",
        f"Packing. Degree 2 or 3: {' or '.join(STEPPED)} (default {STEPPED[0]}); degree 0 or 1: "
        f"{' or '.join(INDEXED)} (default: chosen for a target, else {COMPACT}).",
        panel=MACHINE,
    )
    seed: int = option(DEFAULTS.seed, "S", "Random seed.", panel=TRAINING)

    def protocol(self, config: Config) -> Protocol:
        """Return the protocol; raise InputError for impossible options."""
        own = {name: value for name, value in vars(self).items() if name not in vars(AS_STATED)}
        for name, minimum in (("steps", 0), ("train_steps", 1), ("views", 1)):
            at_least(f"--{name.replace('_', '-')}", own[name], minimum)
        sizes = {name: parse_size(own[name]) for name in ("view_size", "size")}
        if not 0 < self.scale <= 1:
            raise InputError(f"--scale {self.scale:g}: must be above 0 and at most 1")
        made = Protocol(config, **own | sizes, reading=self.reading)
        _ = made.recipe  # raises InputError for an impossible recipe
        return made


@command("bench compression")
def compression_command(
    learning: Learning,
    output: Path = KEPT_FOLDER,
    scene: list[str] | None = argument(
        None,
        "SCENE …",
        "Scene files or folders of photographs (COLMAP, transforms.json). Default: "
        f"{listed(SCENES)} in the folder SPLATCORE_SCENES.",
    ),
    part: str = option(ALL_PARTS, "PART,PART,…", "Parts to measure; see above."),
    ratios: str = option(ALL_RATIOS, "R,R,…", "Compression ratios of the curve."),
    schedule_scene: str | None = option(
        None, "SCENE", "Scene for the comparison of schedules. Default: banana, else the first."
    ),
    config: Config = PRESET,
    liberty: str | None = LIBERTY,
    process: float | None = PROCESS,
):
    """Compress scenes; measure size, loss and machine work.

    Loss is measured on 8-bit pictures of the reference renderer: against the held-out photographs
    (every 7th), or else against the original scene, in views that compression does not learn from
    (the cameras next to the scene file, or generated ones).

    Parts: steps (size, PSNR, SSIM, FLIP, LPIPS if its weights are installed, and the machine's work
    after each step); schedule (pruning schedules with equal numbers of fine-tuning steps); curve
    (ratio against loss); budget (error of compression against error of the machine); power (an
    ESTIMATE after each step, from RTL simulation; see `splatcore power`).

    Writes DIR/compression.json, one CSV file per part, curve.png and one contact sheet per scene.
    Results already in DIR are kept.
    """
    protocol = learning.protocol(config)
    found = find(list(scene or ()))
    chosen = scheduled(schedule_scene, [Path(path).resolve().name for path in found])
    parts, wanted = parse_parts(part), parse_ratios(ratios)
    cells = cells_for(parts, liberty, process)
    compression_run.check_installed()
    make_folder(output)
    facts = bench_compression(found, parts, chosen, wanted, protocol, output, cells)
    for each in (made for scene in facts["scenes"].items() for made in tables(*scene)):
        each.print()
    write_csv(output, facts)
    write_curve(output / "curve.png", facts["scenes"])
    finish(output / RESULT, facts)


def scheduled(asked: str | None, names: list[str]) -> str:
    """Return the scene whose schedules are compared; raise InputError for an unknown one."""
    chosen = Path(asked or (SCENES[0] if SCENES[0] in names else names[0])).name
    if chosen not in names:
        raise InputError(f"--schedule-scene {chosen}: must be one of {', '.join(names)}")
    return chosen


def at_least(option: str, value: int | None, minimum: int):
    """Raise InputError if a number is below a minimum."""
    if value is not None and value < minimum:
        raise InputError(f"{option} {value}: must be {minimum} or more")


def parse_parts(text: str) -> list[str]:
    """Parse parts separated by commas; return them in the order of PARTS."""
    asked = [name.strip() for name in text.split(",")]
    check_known("--part", PARTS, *asked)
    return [name for name in PARTS if name in asked]


def cells_for(
    parts: list[str], liberty: str | None, process: float | None
) -> tuple[Library, float] | None:
    """Read the library; return it and its process in nm. Raise InputError if no part uses it."""
    library = checked_library(liberty, process)
    if library and "power" not in parts:
        raise InputError(f"--liberty {liberty}: goes with --part power only")
    return library and (library, process)


def parse_ratios(text: str) -> tuple[float, ...]:
    """Parse ratios above 1 separated by commas; return them in ascending order."""
    ratios = tuple(sorted(set(numbers("--ratios", text))))
    if not all(1 < ratio < 10_000 for ratio in ratios):
        raise InputError(f"--ratios '{text}': must all be above 1 and below 10,000")
    return ratios
