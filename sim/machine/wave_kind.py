"""Kinds of files of waveforms, and what they need."""

from pathlib import Path

from splatcore.sim.rtl.verilator import has_headers
from splatcore.spec.error import InputError

KINDS = ("vcd", "fst")
FST_HEADERS = ("zlib.h", "lz4.h")

LEVELS, DEEPEST = 4, 99
"""Levels of modules that are recorded: of the whole, with that around the machine, down to the
stages; and of a module that --scope names."""


def check_kind(path: Path) -> str:
    """The kind of waveforms that a file's name asks for: "vcd", or "fst", whose headers must be
    there; InputError for others."""
    kind = path.suffix.lower().removeprefix(".") or KINDS[0]
    if kind not in KINDS:
        raise InputError(f"--waves {path}: does not end with .vcd or .fst")
    if kind == "fst" and not has_headers(*FST_HEADERS):
        raise InputError(
            f"--waves {path}: FST needs {' and '.join(FST_HEADERS)} when the simulation is "
            "compiled (on Debian zlib1g-dev and liblz4-dev); a .vcd needs neither"
        )
    return kind
