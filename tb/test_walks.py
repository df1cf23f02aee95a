"""The walk-throughs in docs/: their commands run one after the other and print what is shown."""

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
COLUMNS = "200"  # of the terminal that tables are set for

REFUSED = 2
"""Exit status of commands that print one line of error; of all others it is 0."""


def steps(text: str) -> list[tuple[str, str]]:
    """Commands and what they print, of the blocks `console` of a page."""
    blocks = "".join(re.findall(r"^```console\n(.*?)^```", text, re.M | re.S))
    found = re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", blocks, re.M)
    return [(command, printed) for command, printed in found]


def check(folder: Path, command: str, expected: str):
    """A command prints what is expected and ends as it should; progress is left out."""
    inside = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    variables = os.environ | {"PATH": inside, "COLUMNS": COLUMNS, "LC_ALL": "C.UTF-8"}
    done = subprocess.run(
        command, shell=True, cwd=folder, env=variables, capture_output=True, text=True
    )
    failed = expected.startswith("error: ")
    assert done.returncode == (REFUSED if failed else 0), f"{command}\n{done.stdout}{done.stderr}"
    printed = done.stderr.splitlines()[-1] + "\n" if failed else done.stdout
    pattern = expected.replace("…", "...")  # what `doctest` calls an ellipsis
    assert OutputChecker().check_output(pattern, printed, RULES), f"{command}\n{printed}"


@pytest.mark.slow
@pytest.mark.parametrize("page", WALKS, ids=lambda page: page.stem)
def test_walk(page, tmp_path):
    found = steps(page.read_text())
    assert len(found) >= 5
    for command, expected in found:
        check(tmp_path, command, expected)


def test_what_differs_is_seen(tmp_path):
    text = "```console\n$ echo one two\none …\n$ echo three\nfour\n$ false\n```\n"
    one, three, false = steps(text)
    check(tmp_path, *one)
    for wrong in (three, false):
        with pytest.raises(AssertionError):
            check(tmp_path, *wrong)
