"""The command `report`: all results on one page."""

from pathlib import Path

import typer

from splatcore.model.formats.file import read_bytes
from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.cli.options import app, option
from splatcore.sim.common.output import console, make_folder, messages
from splatcore.sim.common.source import check_known, parse_size
from splatcore.sim.report.results import Options, Results
from splatcore.sim.report.sections import SECTIONS, compose, write_report
from splatcore.spec.preset import find_preset

OutputOption = option(Path, "DIR", "Folder to write into.", "-o", "--out")
ResultsOption = option(str | None, "DIR", "Folder of results. Default: results in the other one.")
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
    "same numbers. It reads results that other commands left in a folder and runs nothing: `make "
    "report` measures what is missing first, hours for all of it with the real scenes. Each "
    "figure and table names its command. What is missing is named at the end with the command "
    "that makes it, exit status 1, and the rest stands."
    f"\n\nSections: {', '.join(SECTIONS)}. fit shows results/fit/*.json.",
)
def report_command(
    output: OutputOption,
    results: ResultsOption = None,
    section: SectionOption = None,
    scene: SceneOption = None,
    size: SizeOption = None,
    preset: PresetOption = None,
):  # fmt: skip
    names = list(dict.fromkeys(section or SECTIONS))
    check_known("--section", SECTIONS, *names)
    size = "x".join(map(str, parse_size(size))) if size else None
    if preset:
        find_preset(preset)
    for text in scene or ():
        if text not in GENERATORS or Path(text).exists():
            read_bytes(text, 1)
    make_folder(output)
    place = output / "results" if results is None else Path(results)
    found = Results(place, Options(tuple(scene or ()), size, preset))
    parts = [compose(name, found) for name in names]
    for path in write_report(output, parts)[:2]:
        console.print(str(path), soft_wrap=True)
    problems = [(part.name, text) for part in parts for text in part.problems]
    for name, text in problems:
        messages.print(f"{name}: {text}", markup=False, soft_wrap=True)
    if problems:
        raise typer.Exit(1)
