"""Kinds of waveform files, and their requirements."""

from pathlib import Path

from splatcore.sim.rtl.verilator import has_headers
from splatcore.spec.error import InputError

KINDS = ("vcd", "fst")
FST_HEADERS = ("zlib.h", "lz4.h")

LEVELS, DEEPEST = 4, 99
"""Recorded levels of modules: of the whole machine, from the module around it down to the stages;
and of a module named by --scope."""


def check_kind(path: Path) -> str:
    """Kind of waveforms by a file's suffix: "vcd" or "fst".

    Raises InputError for another suffix, and for FST if its C headers are not installed.
    """
    kind = path.suffix.lower().removeprefix(".") or KINDS[0]
    if kind not in KINDS:
        raise InputError(f"--waves {path}: must end in .vcd or .fst")
    if kind == "fst" and not has_headers(*FST_HEADERS):
        raise InputError(
            f"--waves {path}: FST needs {' and '.join(FST_HEADERS)} when the simulation is "
            "compiled (Debian: zlib1g-dev and liblz4-dev); VCD needs neither"
        )
    return kind
