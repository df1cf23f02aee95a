"""The command `report`: all results on one page."""

from pathlib import Path
from typing import Annotated

import typer

from splatcore.model.formats.file import read_bytes
from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.cli.options import app
from splatcore.sim.common.output import check_writable, console, messages
from splatcore.sim.common.source import parse_size
from splatcore.sim.report.results import Options, Results
from splatcore.sim.report.sections import SECTIONS, compose, write_report
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset


@app.command(
    "report",
    help="Write one page that says how fast, how exact and how large the machine is.\n\n"
    "DIR/report.html needs no network and no other file; report.json and tables/*.csv have the "
    "same numbers. It reads results that other commands left in a folder and runs nothing: `make "
    "report` measures what is missing first, hours for all of it with the real scenes. Each "
    "figure and table names its command. What is missing is named at the end with the command "
    "that makes it, exit status 1, and the rest stands."
    f"\n\nSections: {', '.join(SECTIONS)}. fit shows results/fit/*.json.",
)
def report_command(
    output: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Folder to write into.")
    ],
    results: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of results. Default: results in the other one."),
    ] = None,
    section: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this section; repeatable.")
    ] = None,
    scene: Annotated[
        list[str] | None,
        typer.Option(metavar="SCENE", help="Only this scene; repeatable. Default: all measured."),
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Refuse results of another size.")
    ] = None,
    preset: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="Refuse results of another machine.")
    ] = None,
):  # fmt: skip
    names = list(dict.fromkeys(section or SECTIONS))
    if unknown := [name for name in names if name not in SECTIONS]:
        there = ", ".join(SECTIONS)
        raise InputError(f"--section '{unknown[0]}': unknown (there are {there})")
    size = "x".join(map(str, parse_size(size))) if size else None
    if preset:
        find_preset(preset)
    for text in scene or ():
        if text not in GENERATORS or Path(text).exists():
            read_bytes(text, 1)
    check_writable(output / "x" if output.is_dir() else output)
    output.mkdir(exist_ok=True)
    place = output / "results" if results is None else results
    found = Results(place, Options(tuple(scene or ()), size, preset))
    parts = [compose(name, found) for name in names]
    for path in write_report(output, parts)[:2]:
        console.print(str(path), soft_wrap=True)
    problems = [(part.name, text) for part in parts for text in part.problems]
    for name, text in problems:
        messages.print(f"{name}: {text}", markup=False, soft_wrap=True)
    if problems:
        raise typer.Exit(1)
