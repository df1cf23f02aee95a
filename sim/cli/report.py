"""The command `report`: all results on one page."""

from pathlib import Path

import typer

from splatcore.model.formats.file import read_bytes
from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.cli.options import app, option
from splatcore.sim.common.output import console, make_folder, messages
from splatcore.sim.common.size import parse_size
from splatcore.sim.common.source import check_known
from splatcore.sim.report import kept
from splatcore.sim.report.results import Options, Results
from splatcore.sim.report.titles import SECTIONS
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

OutputOption = option(Path, "DIR", "Folder to write into.", "-o", "--out")
ResultsOption = option(
    str | None,
    "DIR",
    "Folder of results, and nothing besides. Default: results in the other one, and what is "
    "missing there from those that the repository keeps.",
)
KeepOption = option(Path | None, "DIR", "Also write the results measured as tables to keep.")
PicturesOption = option(Path | None, "DIR", "Also write the plots of docs/ as PNG.")
SectionOption = option(list[str] | None, "NAME", "Only this section; repeatable.")
SceneOption = option(
    list[str] | None, "SCENE", "Only this scene; repeatable. Default: all measured."
)
SizeOption = option(str | None, "WxH", "Refuse results of another size.")
PresetOption = option(str | None, "NAME|FILE", "Refuse results of another machine.")


@app.command(
    "report",
    help="Write one page that says how fast, how exact and how large the machine is.\n\n"
    "DIR/report.html needs no network and no other file; report.json and tables/*.csv have the "
    "same numbers. It runs nothing: it reads results that other commands left in a folder, and "
    "for what is missing there those of docs/results, which say the command and the version that "
    "made them. Each figure and table names both. `make out/report/results/NAME.json` measures one "
    "again, `make results` what is missing, hours for all of it with the real scenes. What is "
    "missing is named at the end with the command that makes it, exit status 1, and the rest "
    "stands."
    f"\n\nSections: {', '.join(SECTIONS)}. fit shows results/fit/*.json.",
)
def report_command(
    output: OutputOption,
    results: ResultsOption = None,
    section: SectionOption = None,
    scene: SceneOption = None,
    size: SizeOption = None,
    preset: PresetOption = None,
    keep: KeepOption = None,
    pictures: PicturesOption = None,
):  # fmt: skip
    names = list(dict.fromkeys(section or SECTIONS))
    check_known("--section", SECTIONS, *names)
    size = "x".join(map(str, parse_size(size))) if size else None
    if preset:
        find_preset(preset)
    for text in scene or ():
        if text not in GENERATORS or Path(text).exists():
            read_bytes(text, 1)
    if results is None and not kept.FOLDER.is_dir():
        raise InputError(f"{kept.FOLDER}: the kept results are not there; name --results")
    from splatcore.sim.report.sections import compose, write_report

    make_folder(output)
    options = Options(tuple(scene or ()), size, preset)
    found = Results(
        output / "results" if results is None else Path(results), options,
        kept.FOLDER if results is None else None,
    )  # fmt: skip
    parts = [compose(name, found) for name in names]
    for path in write_report(output, parts)[:2]:
        console.print(str(path), soft_wrap=True)
    for path in _more(found, keep, pictures):
        console.print(str(path), soft_wrap=True)
    problems = [(part.name, text) for part in parts for text in part.problems]
    for name, text in problems:
        messages.print(f"{name}: {text}", markup=False, soft_wrap=True)
    if problems:
        raise typer.Exit(1)


def _more(found: Results, keep: Path | None, pictures: Path | None) -> list[Path]:
    """What is written besides the page."""
    from splatcore.sim.report.keep import write_kept, write_pictures

    paths: list[Path] = []
    for folder, write in ((keep, write_kept), (pictures, write_pictures)):
        if folder is not None:
            make_folder(folder)
            paths += write(found, folder)
    return paths
