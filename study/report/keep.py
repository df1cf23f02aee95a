"""Writers of the repository's kept results (docs/results) and of the plots in its documents."""

import io
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image

from splatcore.sim.common import plot
from splatcore.sim.common.output import write
from splatcore.study.report.kept import reproducing, tables
from splatcore.study.report.other import shrunk
from splatcore.study.report.quality import ACROSS, HEIGHT, lines
from splatcore.study.report.results import Results
from splatcore.study.results.known import RESULTS, Result

PICTURE_BYTES = 290_000  # maximum size of a picture

DOTS_PER_INCH = 100


def write_kept(results: Results, folder: Path) -> list[Path]:
    """Write tables and pictures of all measured results to `folder`; return their paths.

    Tables of results that were not measured are not changed.
    """
    files: dict[Path, bytes] = {}
    for name, result in RESULTS.items():
        if not (results.folder / result.file).exists():
            continue
        facts = _facts(results, result)
        found = tables(result, facts, reproducing(result, facts), folder)
        files |= {path: text.encode() for path, text in found.items()}
        for picture in result.pictures:
            with Image.open(results.folder_of(name) / picture) as image:
                files[folder / picture] = shrunk(image.convert("RGB"), PICTURE_BYTES)
    for path, data in files.items():
        write(path, data)
    return list(files)


def _facts(results: Results, result: Result) -> dict:
    """A result's object in the form in which it is kept."""
    name = result.name
    facts = results.facts(name)
    if name == "scenes":  # those that were finished
        facts |= {"rows": [row for row in facts["rows"] if "cycles" in row]}
    if name == "power":  # file names without folders, like the others
        facts |= {key: Path(facts[key]).name for key in ("scene", "camera")}
    return facts


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
