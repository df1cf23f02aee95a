"""Writers of the repository's kept results (docs/results) and of the plots in its documents."""

import io
import shlex
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image

from splatcore.sim.common import plot
from splatcore.sim.common.output import write
from splatcore.spec.config import DEFAULT
from splatcore.study.report.kept import tables
from splatcore.study.report.kept_columns import TABLES
from splatcore.study.report.other import shrunk
from splatcore.study.report.quality import ACROSS, HEIGHT, lines
from splatcore.study.report.results import SOURCES, Results, measured_with

PLACE = "out/report/results"  # the Makefile's default folder of results

PICTURE_BYTES = 290_000  # maximum size of a picture

DOTS_PER_INCH = 100


def write_kept(results: Results, folder: Path) -> list[Path]:
    """Write tables and pictures of all measured results to `folder`; return their paths.

    Tables of results that were not measured are not changed.
    """
    files: dict[Path, bytes] = {}
    for name, kept in TABLES.items():
        if not (results.folder / SOURCES[name][0]).exists():
            continue
        facts = _facts(results, name)
        found = tables(name, facts, command(name, facts), folder)
        files |= {path: text.encode() for path, text in found.items()}
        for picture in kept.pictures:
            with Image.open(results.folder_of(name) / picture) as image:
                files[folder / picture] = shrunk(image.convert("RGB"), PICTURE_BYTES)
    for path, data in files.items():
        write(path, data)
    return list(files)


def _facts(results: Results, name: str) -> dict:
    """A result's object in the form in which it is kept."""
    if name == "scenes":
        rows = [row for row in results.several(name, "*.json") if "cycles" in row]
        return {"rows": rows, "version": results.version(name)}
    facts = results.facts(name)
    if name == "power":  # file names without folders, like the others
        facts |= {key: Path(facts[key]).name for key in ("scene", "camera")}
    return facts


def command(name: str, facts: dict) -> str:
    """The command that reproduces a result; scene files are searched for in SPLATCORE_SCENES."""
    file, takes = SOURCES[name]
    rows = facts.get("rows", ())
    scenes = [facts.get("scene"), *(row.get("scene") for row in rows), *facts.get("scenes", ())]
    first = rows[0] if name == "scenes" else facts
    options, preset = measured_with(first), first.get("preset")
    points = list(facts.get("points", ()))
    values = {
        "SCENES": " ".join(dict.fromkeys(filter(None, scenes))),
        "SIZE": options.size,
        "PRESET": None if preset == DEFAULT.name else preset,
        "POINTS": None if any(" " in point for point in points) else " ".join(points),
    }
    given = [f"{key}={value}" for key, value in values.items() if value and key in takes]
    return shlex.join(["make", *given, f"{PLACE}/{file}"])


def write_pictures(results: Results, folder: Path) -> list[Path]:
    """Write the plots of the README and of docs/ as PNG; return their paths."""
    _, rows = results.rows("quality")
    paths = []
    for key, across in ACROSS.items():
        with rc_context(plot.STYLE):
            figure = Figure((plot.WIDTH, HEIGHT), dpi=DOTS_PER_INCH, layout="constrained")
            lines(figure, rows, across)
            buffer = io.BytesIO()
            figure.savefig(buffer, format="png", metadata={"Software": None})
        image = Image.open(buffer).convert("RGB").quantize(128)
        buffer = io.BytesIO()
        image.save(buffer, "PNG", optimize=True)
        paths.append(folder / f"{key}.png")
        write(paths[-1], buffer.getvalue())
    return paths
