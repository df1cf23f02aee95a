"""The command `bench compression`."""

from pathlib import Path

from splatcore.sim.cli.bench import SIZE, FolderOption, PixelsOption, bench, finish
from splatcore.sim.cli.compress import BesideOption, DegreeOption, QualityOption, RateOption
from splatcore.sim.cli.options import (
    AntialiasedOption,
    AxesOption,
    NearOption,
    PresetOption,
    argument,
    option,
)
from splatcore.sim.cli.power import LibertyOption, ProcessOption, checked_library
from splatcore.sim.common.output import make_folder
from splatcore.sim.common.reading import Reading
from splatcore.sim.common.size import parse_size
from splatcore.sim.common.source import check_known
from splatcore.sim.common.table import print_whole
from splatcore.sim.compression import run as compression_run
from splatcore.sim.compression.bench import BY_ITSELF, PARTS, RATIOS, RESULT, bench_compression
from splatcore.sim.compression.plot import write_curve
from splatcore.sim.compression.subjects import SCENES, Protocol, find
from splatcore.sim.compression.tables import tables, write_csv
from splatcore.sim.eda.liberty import Library
from splatcore.spec.config import DEFAULT
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

DEFAULTS = Protocol(DEFAULT)

ALL_PARTS, ALL_RATIOS = ",".join(BY_ITSELF), ",".join(f"{ratio:g}" for ratio in RATIOS)
VIEW_SIZE = "x".join(map(str, DEFAULTS.view_size))  # defaults as the command line takes them


ScenesArgument = argument(
    list[str] | None,
    "SCENE …",
    "Scene files or folders of photographs (COLMAP, transforms.json). Default: "
    f"{', '.join(SCENES)} in the folder SPLATCORE_SCENES.",
)
PartOption = option(str, "PART,PART,…", "What to measure; see above.")
StepsOption = option(
    int | None, "N", "Fine-tuning steps after each pruning; other parts in proportion."
)
TrainStepsOption = option(int, "N", "Steps of a baseline from photographs.")
RatiosOption = option(str, "R,R,…", "Ratios of the curve.")
ScheduleSceneOption = option(
    str | None, "SCENE", "Whose schedules are compared. Default: banana, else the first."
)
ViewsOption = option(int, "N", "Teacher's views of a scene without photographs.")
ViewSizeOption = option(str, "WxH", "Pixels of the teacher's views.")
ScaleOption = option(float, "S", "Photographs are shrunk to this, 0 … 1.")
OrderOption = option(str, "ORDER", "distill-first, or prune-first as in the paper.")
SeedOption = option(int, "S", "Of everything random.")


@bench.command("compression")
def compression_command(
    output: FolderOption,
    scene: ScenesArgument = None,
    part: PartOption = ALL_PARTS,
    steps: StepsOption = None,
    train_steps: TrainStepsOption = DEFAULTS.train_steps,
    ratios: RatiosOption = ALL_RATIOS,
    schedule_scene: ScheduleSceneOption = None,
    views: ViewsOption = DEFAULTS.views,
    view_size: ViewSizeOption = VIEW_SIZE,
    beside: BesideOption = DEFAULTS.beside,
    size: PixelsOption = SIZE,
    scale: ScaleOption = DEFAULTS.scale,
    rate: RateOption = DEFAULTS.rate,
    order: OrderOption = DEFAULTS.order,
    degree: DegreeOption = DEFAULTS.degree,
    quality: QualityOption = DEFAULTS.quality,
    seed: SeedOption = DEFAULTS.seed,
    antialiased: AntialiasedOption = None,
    axes: AxesOption = None,
    near: NearOption = None,
    preset: PresetOption = "DEFAULT",
    liberty: LibertyOption = None,
    process: ProcessOption = None,
):
    """Compress scenes and measure: the paper's tables, and the work that is left for the machine.

    Quality is that of the reference's 8-bit pictures: against the photographs held out (every 7th)
    where there are some, else against the original scene in views that compression never sees:
    those of the file of cameras beside it, on and beside whose path it learns, or others all round.

    steps: size, PSNR, SSIM, FLIP (LPIPS where its weights are installed) and the machine's work
    after each step. schedule: pruning schedules with the same number of fine-tuning steps.
    curve: ratio against loss. budget: the error of the compressed model beside the machine's.
    power: an ESTIMATE of what the machine takes after each step, simulated in RTL (see `splatcore
    power`); in cells as well with --liberty.

    Writes DIR/compression.json, a CSV file for each part, curve.png and a contact sheet for each
    scene. What is in DIR already is not made again.
    """
    protocol = Protocol(
        find_preset(preset), at_least("--steps", steps, 0), at_least("--train-steps", train_steps),
        at_least("--views", views), parse_size(view_size), beside, parse_size(size), scale, seed,
        rate, order, degree, quality, Reading(antialiased, axes, near),
    )  # fmt: skip
    if not 0 < scale <= 1:
        raise InputError(f"--scale {scale:g}: is not over 0 and at most 1")
    _ = protocol.recipe  # refuses what cannot be
    found = find(list(scene or ()))
    chosen = scheduled(schedule_scene, [Path(path).resolve().name for path in found])
    parts, wanted = parse_parts(part), parse_ratios(ratios)
    cells = cells_for(parts, liberty, process)
    compression_run.check_installed()
    make_folder(output)
    facts = bench_compression(found, parts, chosen, wanted, protocol, output, cells)
    for each in (made for scene in facts["scenes"].items() for made in tables(*scene)):
        print_whole(each)
    write_csv(output, facts)
    write_curve(output / "curve.png", facts["scenes"])
    finish(output / RESULT, facts)


def scheduled(asked: str | None, names: list[str]) -> str:
    """The scene whose schedules are compared; InputError for one that is not there."""
    chosen = Path(asked or (SCENES[0] if SCENES[0] in names else names[0])).name
    if chosen not in names:
        raise InputError(f"--schedule-scene {chosen}: is not among {', '.join(names)}")
    return chosen


def at_least(option: str, value: int | None, least: int = 1) -> int | None:
    """InputError for a number that is too small."""
    if value is not None and value < least:
        raise InputError(f"{option} {value}: is not {least} or more")
    return value


def parse_parts(text: str) -> list[str]:
    """Parts with commas between them, in the order of PARTS."""
    asked = [name.strip() for name in text.split(",")]
    check_known("--part", PARTS, *asked)
    return [name for name in PARTS if name in asked]


def cells_for(
    parts: list[str], liberty: str | None, process: float | None
) -> tuple[Library, float] | None:
    """A library and its process in nm; InputError where no part makes use of it."""
    library = checked_library(liberty, process)
    if library and "power" not in parts:
        raise InputError(f"--liberty {liberty}: goes with --part power only")
    return library and (library, process)


def parse_ratios(text: str) -> tuple[float, ...]:
    """Ratios over 1 with commas between them, the smallest first."""
    try:
        ratios = tuple(sorted(set(map(float, text.split(",")))))
    except ValueError:
        raise InputError(f"--ratios '{text}': are not numbers with commas between them") from None
    if not all(1 < ratio < 10_000 for ratio in ratios):
        raise InputError(f"--ratios '{text}': are not all over 1 and below 10,000")
    return ratios
