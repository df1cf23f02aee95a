"""Tables of `splatcore bench compression`: on the terminal and as CSV."""

import csv
import io
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from splatcore.sim.common.output import write

MEGABYTE = 1e6

Column = tuple[str, Callable[[dict], str]]


def number(name: str, form: str, scale: float = 1.0) -> Callable[[dict], str]:
    """How a value is printed; "–" where there is none."""

    def cell(row: dict) -> str:
        value = row.get(name)
        return "–" if value is None else format(value / scale, form)

    return cell


def valued(name: str, form: str) -> Callable[[dict], str]:
    """A metric with its change against the original."""

    def cell(row: dict) -> str:
        value, change = row.get(name), row.get(f"{name}_change")
        if value is None:
            return "–"
        return format(value, form) + ("" if change is None else f" ({format(change, '+' + form)})")

    return cell


SIZES: tuple[Column, ...] = (
    ("Gaussians", number("gaussians", ",.0f")), ("MB", number("bytes", ".2f", MEGABYTE)),
    ("ratio", number("ratio", ".1f")),
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


def print_tables(console: Console, facts: dict):
    """All tables of a result."""
    for name, scene in facts["scenes"].items():
        for table in tables(name, scene):
            console.print(table)


def tables(name: str, scene: dict) -> Iterator[Table]:
    """A scene's tables, as far as its parts are there."""
    judged = f"{name}, against the {scene['against']} in {scene['views']} held-out views"
    if "steps" in scene:
        rows = [row | row["work"] for row in scene["steps"]["rows"]]
        step = ("step", lambda row: row["step"])
        columns = (step, *SIZES, *metrics(rows))
        yield table(f"{judged} (change against the original)", columns, rows)
        yield table(f"{name}: a frame's work for the machine", (step, *WORK), rows)
    if "schedule" in scene:
        found = scene["schedule"]
        title = f"{judged}: pruning, all with {found['steps_in_all']} fine-tuning steps in all"
        first = {"gaussians": scene["gaussians"], "bytes": scene["ply_bytes"], "ratio": 1.0}
        rows = [first | found["original"], *found["rows"]]
        columns = (
            ("schedule", schedule_text), ("before the last", number("gaussians_before", ",.0f")),
            *SIZES, *metrics(rows),
        )  # fmt: skip
        yield table(title, columns, rows)
    if "curve" in scene:
        rows = scene["curve"]["points"]
        columns = (
            ("target", number("target_ratio", "g")), *SIZES, *metrics(rows),
            ("note", lambda row: row["note"]),
        )  # fmt: skip
        yield table(f"{judged}: ratio against loss", columns, rows)
    if "budget" in scene:
        yield table(f"{judged}: error budget", BUDGET, budget_rows(scene))


def metrics(rows: list[dict]) -> tuple[Column, ...]:
    """Columns of quality; LPIPS where it was measured."""
    return METRICS + (LPIPS if any(row.get("lpips") is not None for row in rows) else ())


def schedule_text(row: dict) -> str:
    """A schedule as --schedule takes it."""
    return ", ".join(f"{rate:.3g}" for rate in row.get("schedule", ())) or "none"


ERRORS = {
    "model": "model: reference against truth",
    "machine": "machine: golden engine against reference",
    "both": "both: golden engine against truth",
}
BUDGET: tuple[Column, ...] = (
    ("error", lambda row: ERRORS[row["error"]]), ("PSNR, dB", number("psnr_db", ".2f")),
    ("least", number("psnr_db_min", ".2f")), ("SSIM", number("ssim", ".5f")),
    ("max error", number("max_error", ".4f")),
)  # fmt: skip


def budget_rows(scene: dict) -> list[dict]:
    """A row for each error."""
    return [{"error": name} | scene["budget"][name] for name in ERRORS]


def table(title: str, columns: tuple[Column, ...], rows: list[dict]) -> Table:
    """A table; the first column is text."""
    found = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title)
    for heading, _ in columns:
        text = heading in (columns[0][0], "note")
        found.add_column(heading, justify="left" if text else "right", overflow="fold")
    for row in rows:
        found.add_row(*(cell(row) for _, cell in columns))
    return found


def write_csv(folder: Path, facts: dict):
    """A file for each part that there is, with all scenes and all numbers of a row."""
    rows: dict[str, list[dict]] = {"steps": [], "schedule": [], "curve": [], "budget": []}
    for name, scene in facts["scenes"].items():
        for row in scene.get("steps", {}).get("rows", ()):
            flat = {key: value for key, value in row.items() if key != "work"}
            rows["steps"].append({"scene": name} | flat | row["work"])
        for row in scene.get("schedule", {}).get("rows", ()):
            rows["schedule"].append({"scene": name} | row | {"schedule": schedule_text(row)})
        for row in scene.get("curve", {}).get("points", ()):
            rows["curve"].append({"scene": name} | row)
        if "budget" in scene:
            rows["budget"] += [{"scene": name} | row for row in budget_rows(scene)]
    for part, found in rows.items():
        if found:
            write(folder / f"{part}.csv", comma_separated(found).encode())


def comma_separated(rows: list[dict]) -> str:
    """All columns that any row has."""
    text = io.StringIO()
    names = dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(text, list(names), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
