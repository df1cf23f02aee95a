"""The walk-throughs in docs/: their commands run in order and print the text shown there."""

import os
import re
import subprocess
import sys
from doctest import ELLIPSIS, NORMALIZE_WHITESPACE, OutputChecker
from pathlib import Path

import pytest

from tb.helpers.command import ROOT

WALKS = sorted((ROOT / "docs").glob("walk_*.md"))

RULES = ELLIPSIS | NORMALIZE_WHITESPACE
COLUMNS = "200"  # width of the terminal in columns, for tables

REFUSED = 2
"""Exit status of a command that prints one line of error; all others exit with 0."""


def steps(text: str) -> list[tuple[str, str]]:
    """Commands of a page's `console` blocks, each with its expected output."""
    blocks = "".join(re.findall(r"^```console\n(.*?)^```", text, re.M | re.S))
    found = re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", blocks, re.M)
    return [(command, printed) for command, printed in found]


def check(folder: Path, command: str, expected: str):
    """Run a command; check its output and exit status, without progress lines."""
    inside = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    variables = os.environ | {"PATH": inside, "COLUMNS": COLUMNS, "LC_ALL": "C.UTF-8"}
    done = subprocess.run(
        command, shell=True, cwd=folder, env=variables, capture_output=True, text=True
    )
    failed = expected.startswith("error: ")
    assert done.returncode == (REFUSED if failed else 0), f"{command}\n{done.stdout}{done.stderr}"
    printed = done.stderr.splitlines()[-1] + "\n" if failed else done.stdout
    pattern = expected.replace("…", "...")  # doctest's ellipsis
    assert OutputChecker().check_output(pattern, printed, RULES), f"{command}\n{printed}"


@pytest.mark.slow
@pytest.mark.parametrize("page", WALKS, ids=lambda page: page.stem)
def test_walk(page, tmp_path):
    found = steps(page.read_text())
    assert len(found) >= 5
    for command, expected in found:
        check(tmp_path, command, expected)


def test_differences_are_found(tmp_path):
    text = "```console\n$ echo one two\none …\n$ echo three\nfour\n$ false\n```\n"
    one, three, false = steps(text)
    check(tmp_path, *one)
    for wrong in (three, false):
        with pytest.raises(AssertionError):
            check(tmp_path, *wrong)
