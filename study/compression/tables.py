"""Tables of `splatcore bench compression`, for the terminal and as CSV."""

from collections.abc import Callable, Iterator
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.sim.common.output import write
from splatcore.sim.common.table import comma_separated, shown
from splatcore.study.compression.bench import PARTS

MEGABYTE, MILLI = 1e6, 1e-3

BESIDE = "psnr_db_beside"  # key of a row: dB off the path, by position of the view

Column = tuple[str, Callable[[dict], str]]


def number(name: str, form: str, scale: float = 1.0) -> Callable[[dict], str]:
    """Formatter of a row's value, divided by `scale`; "–" if it is missing."""
    return lambda row: shown(row.get(name), form, scale)


def valued(name: str, form: str) -> Callable[[dict], str]:
    """Formatter of a row's metric with its change from the original."""

    def cell(row: dict) -> str:
        value, change = row.get(name), row.get(f"{name}_change")
        if value is None:
            return "–"
        return format(value, form) + ("" if change is None else f" ({format(change, '+' + form)})")

    return cell


SIZES: tuple[Column, ...] = (
    ("Gaussians", number("gaussians", ",.0f")), ("MB", number("bytes", ".2f", MEGABYTE)),
    ("ratio", number("ratio", ".1f")), ("degree", number("sh_degree", ".0f")),
)  # fmt: skip
METRICS: tuple[Column, ...] = (
    ("PSNR, dB", valued("psnr_db", ".2f")), ("SSIM", valued("ssim", ".3f")),
    ("FLIP", valued("flip", ".3f")),
)  # fmt: skip
LPIPS: tuple[Column, ...] = (("LPIPS", valued("lpips", ".3f")),)
WORK: tuple[Column, ...] = (
    ("visible", number("splats", ",.0f")), ("pairs", number("tile_pairs", ",.0f")),
    ("pairs done", number("pairs", ",.0f")),
    ("k cycles", number("cycles", ",.0f", 1000)), ("FPS", number("fps_at_800mhz", ".0f")),
)  # fmt: skip


def tables(name: str, scene: dict) -> Iterator[Table]:
    """Yield the tables of a scene's measured parts."""
    judged = f"{name}, against the {scene['against']} in {scene['views']} held-out views"
    if rows := rows_of(scene, "steps"):
        step = ("step", lambda row: row["step"])
        columns = (step, *SIZES, *metrics(rows))
        yield table(f"{judged} (in brackets: change from the original)", columns, rows)
        yield table(f"{name}: the machine's work per frame", (step, *WORK), rows)
    if "schedule" in scene:
        found = scene["schedule"]
        title = f"{judged}: pruning schedules, {found['steps_in_all']} fine-tuning steps in total"
        first = {name: scene[name] for name in ("gaussians", "sh_degree")}
        first |= {"bytes": scene["ply_bytes"], "ratio": 1.0}
        rows = [first | found["original"], *rows_of(scene, "schedule")]
        columns = (
            ("schedule", schedule_text), ("before the last", number("gaussians_before", ",.0f")),
            *SIZES, *metrics(rows),
        )  # fmt: skip
        yield table(title, columns, rows)
    if rows := rows_of(scene, "curve"):
        columns = (
            ("target", number("target_ratio", "g")), *SIZES,
            ("bytes per Gaussian", number("bytes_each", ".2f")), *metrics(rows),
            ("FPS", number("fps_at_800mhz", ".0f")),
            ("note", lambda row: row["note"]),
        )  # fmt: skip
        yield table(f"{judged}: ratio against loss", columns, rows)
    if rows := rows_of(scene, "budget"):
        yield table(f"{judged}: error budget", BUDGET, rows)
    if rows := rows_of(scene, "power"):
        found = scene["power"]
        view = f"view {found['view']} at {'x'.join(map(str, found['size']))}"
        cells = (CELLS,) if "library" in found else ()
        yield table(f"{name}, {view}: power, an ESTIMATE", (*POWER, *cells), rows)


def metrics(rows: list[dict]) -> tuple[Column, ...]:
    """Columns of quality, with LPIPS and PSNR off the path if measured."""
    columns = METRICS + (LPIPS if any(row.get("lpips") is not None for row in rows) else ())
    names = dict.fromkeys(name for row in rows for name in row.get(BESIDE, ()))
    return columns + tuple((f"{name}, dB", beside(name)) for name in names)


def beside(name: str) -> Callable[[dict], str]:
    """Formatter of the PSNR in a view off the path."""
    return lambda row: shown(row.get(BESIDE, {}).get(name), ".2f")


def schedule_text(row: dict) -> str:
    """A schedule as text, in the syntax of --schedule."""
    return ", ".join(f"{rate:.3g}" for rate in row.get("schedule", ())) or "none"


ERRORS = {
    "model": "model: reference against truth",
    "machine": "machine: golden model against reference",
    "both": "both: golden model against truth",
}
BUDGET: tuple[Column, ...] = (
    ("error", lambda row: ERRORS[row["error"]]), ("PSNR, dB", number("psnr_db", ".2f")),
    ("lowest", number("psnr_db_min", ".2f")), ("SSIM", number("ssim", ".5f")),
    ("max error", number("max_error", ".4f")),
)  # fmt: skip

POWER: tuple[Column, ...] = (
    ("step", lambda row: row["step"]), *(column for column in SIZES if column[0] != "ratio"),
    ("k cycles", number("cycles", ",.0f", 1000)), ("max FPS", number("fps_at_800mhz", ".0f")),
    ("MB per frame", number("traffic_bytes", ".2f", MEGABYTE)),
    ("at FPS", number("fps", ".0f")), ("mW", number("power_w", ".0f", MILLI)),
    ("leakage, mW", number("leakage_w", ".0f", MILLI)),
    ("mJ per frame", number("frame_j", ".2f", MILLI)), ("DRAM, mW", number("dram_w", ".0f", MILLI)),
)  # fmt: skip
CELLS: Column = ("mW in cells", number("cells_w", ".0f", MILLI))


def table(title: str, columns: tuple[Column, ...], rows: list[dict]) -> Table:
    """Make a table; the first column and "note" are text."""
    found = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title)
    for heading, _ in columns:
        text = heading in (columns[0][0], "note")
        found.add_column(heading, justify="left" if text else "right", overflow="fold")
    for row in rows:
        found.add_row(*(cell(row) for _, cell in columns))
    return found


def rows_of(scene: dict, part: str) -> list[dict]:
    """The rows of a scene's part; empty if it was not measured."""
    found = scene.get(part)
    if not found:
        return []
    if part == "budget":
        return [{"error": name} | found[name] for name in ERRORS]
    return [row | row.get("work", {}) for row in found["points" if part == "curve" else "rows"]]


def write_csv(folder: Path, facts: dict):
    """Write one CSV file per measured part, with all scenes and all numbers."""
    for part in PARTS:
        rows = []
        for name, scene in facts["scenes"].items():
            for row in rows_of(scene, part):
                text = {"schedule": schedule_text(row)} if part == "schedule" else {}
                aside = {f"{at} psnr_db": db for at, db in row.get(BESIDE, {}).items()}
                rows.append({"scene": name} | row | text | aside)
                for key in ("work", BESIDE):
                    rows[-1].pop(key, None)
        if rows:
            write(folder / f"{part}.csv", comma_separated(rows).encode())
