"""The version that makes a result: the package's and, in a checkout, the commit."""

import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as of_package
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]


@cache
def version() -> str:
    """Return `0.1.0, commit 1a2b3c4d5e`, with -dirty if files differ; without git `0.1.0`."""
    try:
        package = of_package("splatcore")
    except PackageNotFoundError:  # a folder of sources that is not installed
        package = "not installed"
    if not (CHECKOUT / ".git").exists():
        return package
    words = ["git", "-C", str(CHECKOUT), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        found = subprocess.run([*words, "--abbrev=10"], capture_output=True, text=True)
    except OSError:  # there is no git
        return package
    return f"{package}, commit {found.stdout.strip()}" if found.returncode == 0 else package
