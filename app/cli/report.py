"""The command `report`: one page of all results."""

from pathlib import Path

import typer

from splatcore.app.cli.commands import COMMANDS
from splatcore.app.cli.options import MACHINE, SCENE, command, option
from splatcore.model.formats.file import read_bytes
from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, make_folder, messages
from splatcore.sim.frame.size import parse_size
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from splatcore.study.report import kept
from splatcore.study.report.kept import Options
from splatcore.study.report.results import Results
from splatcore.study.report.titles import SECTIONS, titles


@command(
    "report",
    help=f"{COMMANDS['report'].summary}\n\n"
    "DIR/report.html needs no network and no other file; report.json and tables/*.csv have the "
    "same numbers. Nothing is measured: results come from files that other commands wrote, or else "
    "from docs/results. Each figure and table names the command and version behind it. "
    "`make out/report/results/NAME.json` re-measures one result; `make results` measures all "
    "missing ones, which takes hours with the real scenes. A missing result is listed at the end "
    "with the command that makes it, and the exit status is 1."
    f"\n\nSections: {', '.join(SECTIONS)}. Section fit shows results/fit/*.json.",
)
def report_command(
    output: Path = option(..., "DIR", "Folder to write into.", "-o", "--out"),
    results: str | None = option(
        None,
        "DIR",
        "Read results from this folder only. Default: from results in the -o folder, and those "
        "missing there from docs/results.",
    ),
    section: list[str] | None = option(None, "NAME", "Show only this section; may be repeated."),
    scene: list[str] | None = option(
        None,
        "SCENE",
        "Show only this scene; may be repeated. Default: all measured.",
        panel=SCENE,
    ),
    size: str | None = option(None, "WxH", "Refuse results of another size.", panel=SCENE),
    preset: str | None = option(
        None, "NAME|FILE", "Refuse results of another machine.", panel=MACHINE
    ),
    keep: Path | None = option(None, "DIR", "Also write the results as tables for docs/results."),
    pictures: Path | None = option(None, "DIR", "Also write the plots of docs/ as PNG."),
):
    names = list(dict.fromkeys(section or titles()))
    check_known("--section", titles(), *names)
    size = "x".join(map(str, parse_size(size))) if size else None
    if preset:
        find_preset(preset)
    for text in scene or ():
        if text not in GENERATORS or Path(text).exists():
            read_bytes(text, 1)
    if results is None and not kept.FOLDER.is_dir():
        raise InputError(f"{kept.FOLDER}: folder does not exist; use --results")
    from splatcore.study.report.sections import compose, write_report

    make_folder(output)
    options = Options(tuple(scene or ()), size, preset)
    found = Results(
        output / "results" if results is None else Path(results), options,
        kept.FOLDER if results is None else None,
    )  # fmt: skip
    parts = [compose(name, found) for name in names]
    for path in write_report(output, parts)[:2]:
        console.print(str(path))
    for path in _more(found, keep, pictures):
        console.print(str(path))
    problems = [(part.name, text) for part in parts for text in part.problems]
    for name, text in problems:
        messages.print(f"{name}: {text}", soft_wrap=True)
    if problems:
        raise typer.Exit(1)


def _more(found: Results, keep: Path | None, pictures: Path | None) -> list[Path]:
    """Write tables and plots, if requested; return their paths."""
    from splatcore.study.report.keep import write_kept, write_pictures

    paths: list[Path] = []
    for folder, write in ((keep, write_kept), (pictures, write_pictures)):
        if folder is not None:
            make_folder(folder)
            paths += write(found, folder)
    return paths
