"""The command line as tests run it, and the repository's folder."""

import json
from pathlib import Path

import pytest

from splatcore.sim.cli.main import main

ROOT = Path(__file__).resolve().parents[2]

KEYS = [
    "engine", "preset", "scene", "camera", "size", "seconds", "counts", "psnr_db", "ssim",
    "max_error", "identical", "cycles", "fps_at_800mhz", "traffic_bytes",
]  # fmt: skip
"""Keys of the object that `--json` writes."""


def run(*arguments: str) -> int:
    """Exit status of `splatcore ARGUMENTS`."""
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    return stop.value.code or 0


def load(path) -> dict:
    return json.loads(path.read_text())
