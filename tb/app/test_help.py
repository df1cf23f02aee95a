"""The help of every command: short or under headings, with one example; docs/commands.md."""

import re

import pytest
import typer

from splatcore.app.cli import commands
from splatcore.app.cli.commands import COMMANDS, PURPOSES
from splatcore.app.cli.main import register
from splatcore.app.cli.options import app
from splatcore.app.cli.reference import all_commands, page
from splatcore.study.bench.scenes import MORE_CAMERAS
from tb.helpers.command import ROOT
from tb.helpers.known_words import unknown_words

LINES = 40  # of a screen
COLUMNS = 100
EXAMPLE = 68  # characters of an example that fits a line of 80

ALIKE = (
    "--camera --cameras --size --antialiased --axes --lod --near --preset --quality --json".split()
)
"""Options of many commands."""


def all_parts() -> dict[str, typer.core.TyperCommand]:
    """The program, its groups and its commands by name."""
    register()
    program = typer.main.get_command(app)
    groups = {name: program.commands[name] for name in commands.GROUPS}
    return {"": program} | groups | dict(all_commands(program))


def printed(command, words: str, capsys, monkeypatch) -> str:
    """Return the help as a terminal of `COLUMNS` shows it."""
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    monkeypatch.setenv("NO_COLOR", "1")
    capsys.readouterr()
    command.main(["--help"], prog_name=f"splatcore {words}".strip(), standalone_mode=False)
    return capsys.readouterr().out


def offences(text: str) -> list[str]:
    """Return the faults of a help text."""
    found = []
    headings = set(re.findall(r"^╭─ (.+?) ─+╮$", text, re.M)) - {"Arguments", "Options"}
    if len(text.strip().splitlines()) > LINES and len(headings) < 2:
        found.append("is longer than a screen, without headings")
    examples = re.findall(r"^ ?Example: +splatcore (.+)$", text, re.M)
    if len(examples) != 1 or text.count("Example") != 1:
        return [*found, f"has {len(examples)} examples"]
    example = examples[0].split()
    if len(" ".join(example)) + len("splatcore ") > EXAMPLE:
        found.append("has an example that does not fit a line")
    return found + [f"unknown: {word}" for word in unknown_words(example)]


@pytest.mark.parametrize("words", ["", *commands.GROUPS, *COMMANDS])
def test_help_fits_and_has_an_example(words, capsys, monkeypatch):
    command = all_parts()[words]
    assert offences(printed(command, words, capsys, monkeypatch)) == []


@pytest.mark.parametrize("name", COMMANDS)
def test_example_is_complete(name):
    """It has all required arguments and options, with values of the right types."""
    command, arguments = all_parts()[name], COMMANDS[name].arguments.split()
    command.make_context(name, arguments)


def test_summary_is_the_first_line_of_the_help():
    found = all_parts()
    for name, entry in COMMANDS.items():
        assert found[name].help.split("\n\n")[0] == entry.summary == found[name].short_help, name
        assert entry.purpose in PURPOSES


def test_cameras_of_benches_are_named():
    found = all_parts()["bench scenes"].params
    (option,) = (each for each in found if each.name == "cameras")
    for scene, cameras in MORE_CAMERAS.items():
        assert f"for {scene} also {' and '.join(cameras)}" in option.help


def test_shared_options_have_one_heading():
    """Except `--cameras FILE.json`, which is written."""
    options = [each for command in all_parts().values() for each in command.params]
    for name in ALIKE:
        alike = [each for each in options if name in each.opts]
        headings = {
            each.rich_help_panel
            for each in alike
            if (name, each.metavar) != ("--cameras", "FILE.json")
        }
        assert len(headings) == 1 and headings != {None}, name


GOOD = "Usage: …\n\n Example:  splatcore render garden -o a.png\n"
LONG = "line\n" * LINES + GOOD

OFFENDERS = {
    LONG: "is longer than a screen, without headings",
    "╭─ Options ──╮\n╭─ Output ──╮\n" + LONG: "is longer than a screen, without headings",
    "": "has 0 examples",
    GOOD + GOOD: "has 2 examples",
    GOOD.replace("garden", "garden" * 9): "has an example that does not fit a line",
    GOOD.replace("-o", "--none"): "unknown: --none",
    GOOD.replace("render", "rendr"): "unknown: rendr",
}


@pytest.mark.parametrize("text", OFFENDERS)
def test_an_offender_is_seen(text):
    assert offences(GOOD) == offences("╭─ Video ──╮\n╭─ Output ──╮\n" + LONG) == []
    assert offences(text) == [OFFENDERS[text]]


def test_the_page_of_commands_is_of_the_help():
    """`make commands` writes it."""
    assert (ROOT / "docs/commands.md").read_text() == page()
