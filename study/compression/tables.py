"""Tables of `splatcore bench compression`, for the terminal and as CSV."""

from collections.abc import Iterator
from pathlib import Path

from splatcore.sim.common.output import write
from splatcore.sim.common.table import Column, Table, comma_separated
from splatcore.study.compression.bench import PARTS
from splatcore.study.results.compression import Point, PowerRow, StepRow
from splatcore.study.results.fields import columns

BESIDE = "psnr_db_beside"  # key of a row: dB off the path, by position of the view

SIZES = "gaussians bytes ratio sh_degree"
WORK = "splats tile_pairs pairs cycles fps_at_800mhz"
POWER = (
    "step gaussians bytes sh_degree cycles fps_at_800mhz traffic_bytes fps power_w leakage_w "
    "frame_j dram_w"
)
"""Keys of columns."""


def metrics(rows: list[dict]) -> Iterator[Column]:
    """Columns of quality with changes from the original, LPIPS and PSNR off the path if known."""
    for column in columns(StepRow, "psnr_db ssim flip lpips"):
        if column.get == "lpips" and all(row.get("lpips") is None for row in rows):
            continue

        def cell(row: dict, column: Column = column) -> str | None:
            value, change = row.get(column.get), row.get(f"{column.get}_change")
            text = "" if change is None else f" ({change:+.{column.digits}f})"
            return None if value is None else column.cell(value) + text

        yield Column(column.name, column.unit, column.digits, get=cell)
    for name in dict.fromkeys(name for row in rows for name in row.get(BESIDE, ())):
        yield Column(name, "dB", 2, get=f"{BESIDE}.{name}")


def tables(name: str, scene: dict) -> Iterator[Table]:
    """Yield the tables of a scene's measured parts."""
    judged = f"{name}, against the {scene['against']} in {scene['views']} held-out views"
    sizes = columns(StepRow, SIZES)
    if rows := rows_of(scene, "steps"):
        step = Column("step")
        title = f"{judged} (in brackets: change from the original)"
        yield Table.of("steps", title, [step, *sizes, *metrics(rows)], rows)
        work = columns(StepRow, " ".join(f"work.{key}" for key in WORK.split()))
        yield Table.of("work", f"{name}: the machine's work per frame", [step, *work], rows)
    if "schedule" in scene:
        found = scene["schedule"]
        title = f"{judged}: pruning schedules, {found['steps_in_all']} fine-tuning steps in total"
        first = {name: scene[name] for name in ("gaussians", "sh_degree")}
        first |= {"bytes": scene["ply_bytes"], "ratio": 1.0}
        rows = [first | found["original"], *rows_of(scene, "schedule")]
        schedule = Column("schedule", get=schedule_text)
        before = Column("before the last", digits=0, get="gaussians_before")
        yield Table.of("schedule", title, [schedule, before, *sizes, *metrics(rows)], rows)
    if rows := rows_of(scene, "curve"):
        target, each, fps, note = columns(
            Point, "target_ratio bytes_each work.fps_at_800mhz note"
        )  # fmt: skip
        shown = [target, *sizes, each, *metrics(rows), fps, note]
        yield Table.of("curve", f"{judged}: ratio against loss", shown, rows)
    if rows := rows_of(scene, "budget"):
        shown = [Column("error", get=lambda row: ERRORS[row["error"]]), *columns(Point, LOSS)]
        yield Table.of("budget", f"{judged}: error budget", shown, rows)
    if rows := rows_of(scene, "power"):
        found = scene["power"]
        view = f"view {found['view']} at {'x'.join(map(str, found['size']))}"
        shown = columns(PowerRow, POWER + " cells_w" * ("library" in found))
        yield Table.of("power", f"{name}, {view}: power, an ESTIMATE", shown, rows)


LOSS = "psnr_db psnr_db_min ssim max_error"

ERRORS = {
    "model": "model: reference against truth",
    "machine": "machine: golden model against reference",
    "both": "both: golden model against truth",
}


def schedule_text(row: dict) -> str:
    """A schedule as text, in the syntax of --schedule."""
    return ", ".join(f"{rate:.3g}" for rate in row.get("schedule", ())) or "none"


def rows_of(scene: dict, part: str) -> list[dict]:
    """The rows of a scene's part; empty if it was not measured."""
    found = scene.get(part)
    if not found:
        return []
    if part == "budget":
        return [{"error": name} | found[name] for name in ERRORS]
    return found["points" if part == "curve" else "rows"]


def write_csv(folder: Path, facts: dict):
    """Write one CSV file per measured part, with all scenes and all numbers."""
    for part in PARTS:
        rows = []
        for name, scene in facts["scenes"].items():
            for row in rows_of(scene, part):
                text = {"schedule": schedule_text(row)} if part == "schedule" else {}
                aside = {f"{at} psnr_db": db for at, db in row.get(BESIDE, {}).items()}
                plain = {key: row[key] for key in row if key not in ("work", BESIDE)}
                rows.append({"scene": name} | plain | row.get("work", {}) | text | aside)
        if rows:
            write(folder / f"{part}.csv", comma_separated(rows).encode())
