"""Compiles a Verilog module and the C++ that drives it to a program, by Verilator, once."""

import os
import shutil
import subprocess
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from splatcore.sim.common.cache import cache_root, digest, kept_folder
from splatcore.sim.rtl.coverage import COUNTING, counted
from splatcore.sim.rtl.initial import STATE, without_initial
from splatcore.sim.rtl.verilator import environment

KIND = "streams"  # the folder of compiled simulations among what is kept
CPP = Path(__file__).parent  # the folder of the C++

SPLIT = "--output-split 200000 --output-split-cfuncs 1000 --output-split-ctrace 1000".split()
"""Few files of short functions: each file costs the C++ compiler the headers, and a function more
time than its length."""

ARGS = [
    "--cc", "--exe", "--build", "--build-jobs", "2", "-O3", "--x-assign", "fast", "-Wno-fatal",
    "--assert", *STATE, *SPLIT, "--top-module", "top", "-Mdir", "obj", "-CFLAGS", "-I..",
]  # fmt: skip

QUICK, FAST = "-O1", "-O2"
"""Levels of the C++ compiler: compiled in two thirds of the time, or a tenth faster afterwards."""

LOG_LINES = 40

LATER = 3600  # seconds; more than any program takes to compile


class SimulationError(AssertionError):
    """The simulation broke off: an assertion failed in the component, or logic did not settle."""


def build(
    source: str,
    main: Path,
    made: dict[str, str],
    headers: Iterable[Path] = (),
    more: tuple[str, ...] = (),
    level: str = QUICK,
) -> Path:
    """The program of a Verilog module `top`, initial values left out, and a C++ main.

    made: files that the main includes, as text by their names. headers: further ones, besides
    those of this folder, which every main may include. more: arguments for Verilator. level: of
    the C++ compiler. Raises RuntimeError with the end of the compiler's log.
    """
    args = [*ARGS, *more, *(COUNTING if counted() else ())]
    texts = {file.name: file.read_text() for file in (main, *CPP.glob("*.hpp"), *headers)}
    texts |= made | {"top.sv": without_initial(source)}

    def compile(folder: Path):
        for name, text in texts.items():
            (folder / name).write_text(text)
        _compile(folder, main.name, args, level)

    return kept_folder(KIND, [texts, args, level], compile) / "obj" / "Vtop"


def _compile(folder: Path, main: str, args: list[str], level: str) -> None:
    """Run Verilator and the C++ compiler in a folder; RuntimeError with the end of their log."""
    variables = environment()
    program = shutil.which("verilator", path=variables["PATH"])
    with library(folder / "obj", variables, args):
        done = subprocess.run(
            [program, *args, "-MAKEFLAGS", f"OPT_FAST={level}", "top.sv", main],
            cwd=folder, env=variables, capture_output=True, text=True, check=False,
        )  # fmt: skip
    if done.returncode:
        log = (done.stdout + done.stderr).splitlines()[-LOG_LINES:]
        raise RuntimeError("\n".join([f"Verilator or g++ failed in {folder}", *log]))


@contextmanager
def library(objects: Path, variables: dict[str, str], args: list[str]) -> Iterator[None]:
    """Have objects of Verilator's own library, the same for all programs, in a folder of objects.

    Most of the time would go into them: they are compiled once for an environment and arguments.
    """
    program = shutil.which("verilator", path=variables["PATH"])
    version = subprocess.run(
        [program, "--version"], env=variables, capture_output=True, check=False
    )
    made_from = [program, version.stdout, variables.get("MAKEFLAGS"), args]
    kept = cache_root() / KIND / f"library-{digest(made_from)}"
    for folder in (kept, objects):
        folder.mkdir(parents=True, exist_ok=True)
    _copy(kept, objects)
    yield
    _copy(objects, kept)


def _copy(source: Path, target: Path) -> None:
    """Copy what is compiled of the library, as if it was made later: `make` takes it as it is."""
    for file in source.glob("verilated*.o"):
        if not (target / file.name).exists():
            scratch = target / f"{file.name}.{os.getpid()}"  # others may be copying it too
            shutil.copy(file, scratch)
            os.utime(scratch, (later := time.time() + LATER, later))
            scratch.replace(target / file.name)
