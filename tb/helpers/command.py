"""Run the command line in tests; the repository's folder."""

import json
import os
import re
import subprocess
from collections.abc import Iterable
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from splatcore.app.cli.main import main
from splatcore.model.formats.ply import write_ply
from splatcore.sim.common import output
from tb.helpers.clouds import cloud

ROOT = Path(__file__).resolve().parents[2]

KEYS = [
    "engine", "preset", "scene", "camera", "size", "antialiased", "antialiased_by", "near",
    "notes", "seconds", "counts", "psnr_db_machine", "psnr_db_scene", "ssim_machine", "ssim_scene",
    "max_error_machine", "max_error_scene", "identical", "cycles", "fps_at_800mhz",
    "traffic_bytes", "packing",
]  # fmt: skip
"""Keys written by `render --json`."""


def run(*arguments: object) -> int:
    """Exit status of `splatcore ARGUMENTS`; a single argument is split into words."""
    words = arguments[0].split() if len(arguments) == 1 else map(str, arguments)
    with pytest.raises(SystemExit) as stop:
        main(list(words))
    return stop.value.code or 0


def check_refused(capsys, arguments: str, message: str):
    """Check that a command is refused with one line of error that matches the pattern `message`.

    Lines of progress are suppressed, as the command may work for a while before it fails.
    """
    capsys.readouterr()
    with patch.object(output, "EVERY", 3600):
        assert run(arguments) == 2
    printed = capsys.readouterr()
    assert not printed.out and re.fullmatch(r"error: [^\n]+\n", printed.err), printed.err
    assert re.search(message, printed.err), printed.err


def check_documented(heading: str, keys: Iterable[str]):
    """Check that docs/json.md documents every key in the section of a heading."""
    section = (ROOT / "docs" / "json.md").read_text().partition(heading)[2].partition("\n## ")[0]
    assert not [key for key in keys if f"`{key}`" not in section]


def make(*words: str, **variables: str) -> subprocess.CompletedProcess:
    """Run make in the repository, without installing, and without variables of an outer make."""
    variables = [f"{name}={value}" for name, value in variables.items()]
    made = ("install", ".venv/installed", ".venv/test")
    return subprocess.run(
        ["make", *(f"--old-file={name}" for name in made), *variables, *words], cwd=ROOT,
        env={name: value for name, value in os.environ.items() if "MAKE" not in name},
        capture_output=True, text=True,
    )  # fmt: skip


def load(path) -> dict:
    """Read a JSON file's object, without `version`, which all results have."""
    facts = json.loads(path.read_text())
    facts.pop("version", None)
    return facts


def write_scene(folder: Path):
    """Write a small scene and two cameras: scene.ply, cameras.json."""
    scene = cloud(0, count=200)
    depth = scene.position[:, 2] + 3  # none just in front of the near plane: no note
    scene.position[(depth > 0) & (depth < 0.21), 2] += 0.3
    write_ply(folder / "scene.ply", scene)
    cameras = [
        {"id": n, "img_name": f"view_{n}", "width": 64, "height": 48, "fx": 60.0, "fy": 60.0,
         "position": [0.1 * n, 0, -3], "rotation": np.eye(3).tolist()}
        for n in (4, 7)
    ]  # fmt: skip
    (folder / "cameras.json").write_text(json.dumps(cameras))
