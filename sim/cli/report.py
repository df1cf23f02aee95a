"""The command `report`: all results on one page."""

from pathlib import Path
from typing import Annotated

import typer

from splatcore.model.formats.file import read_bytes
from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.cli.options import app
from splatcore.sim.common.output import check_writable, console, messages
from splatcore.sim.common.source import parse_size
from splatcore.sim.report.options import GENERATED, GENERATED_SIZE, Options
from splatcore.sim.report.results import Results
from splatcore.sim.report.sections import SECTIONS, compose, write_report
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset


@app.command(
    "report",
    help="Write one page that says how fast, how exact and how large the machine is.\n\n"
    "DIR/report.html needs no network and no other file; report.json and tables/*.csv have the "
    "same numbers. It is made from what other commands left in the folder of results; what is not "
    "there is measured first, hours for all of it with the real scenes. Each figure and table "
    "names its command. What cannot be had is named at the end, exit status 1, and the rest "
    "stands."
    f"\n\nSections: {', '.join(SECTIONS)}. fit shows results/fit/*.json and runs nothing.",
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
        typer.Option(
            metavar="SCENE", help="Scene to measure; repeatable. Default: all in the folder "
            f"SPLATCORE_SCENES, without it '{GENERATED}' at {GENERATED_SIZE}.",
        ),
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Pixels. Default: 1920x1080.")
    ] = None,
    preset: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="Machine. Default: DEFAULT.")
    ] = None,
    run: Annotated[
        bool, typer.Option("--run/--no-run", help="Whether to measure what is missing.")
    ] = True,
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
    options = Options(tuple(scene or ()), size, preset)
    parts = compose(names, Results(place, options, run))
    for path in write_report(output, parts)[:2]:
        console.print(str(path), soft_wrap=True)
    problems = [(part.name, text) for part in parts for text in part.problems]
    for name, text in problems:
        messages.print(f"{name}: {text}", markup=False, soft_wrap=True)
    if problems:
        raise typer.Exit(1)
