"""Compile a Verilog module and the C++ that drives it by Verilator; programs are cached."""

import os
import shutil
import subprocess
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from splatcore.sim.common.output import write
from splatcore.sim.rtl.coverage import COUNTING, counted
from splatcore.sim.rtl.verilator import (
    STATE,
    environment,
    installed,
    with_settings,
    without_initial,
)
from splatcore.spec.cache import cache_root, digest, kept_folder
from splatcore.spec.progress import report

KIND = "streams"  # the cache's folder of compiled simulations
CPP = Path(__file__).parent  # the folder of the C++

SPLIT = "--output-split 200000 --output-split-cfuncs 1000 --output-split-ctrace 1000".split()
"""Few files of short functions: the compiler reads the headers for each file, and its time grows
faster than the length of a function."""

ARGS = [
    "--cc", "--exe", "--build", "--build-jobs", "2", "-O3", "--x-assign", "fast", "--assert",
    "-Wno-lint", "-Wno-fatal", *STATE, *SPLIT, "--top-module", "top", "-Mdir", "obj",
    "-CFLAGS", "-I..",
]  # fmt: skip

QUICK, FAST = "-O1", "-O2"
"""Optimisation levels of the C++ compiler: QUICK compiles in two thirds of the time, FAST programs
run a tenth faster."""

SLOW = "-O0"  # of code that runs once

HEADER = """\
#ifndef SHARED_HEADER
#define SHARED_HEADER
#include "verilated.h"
#endif
"""
"""The header that all programs include first: reading it takes longer than a small program's own
code. A compiler that finds it precompiled beside it takes that."""

COMPILING = "compiling"  # the phase of Verilator and the C++ compiler

LOG_LINES = 40

LATER = 3600  # seconds; longer than any program takes to compile


class SimulationError(AssertionError):
    """The simulation failed: an assertion in the component, or logic that does not settle."""


def build(
    source: str,
    main: Path,
    made: dict[str, str],
    headers: Iterable[Path] = (),
    more: tuple[str, ...] = (),
    level: str = QUICK,
) -> Path:
    """Compile a Verilog module `top`, without initial values, and a C++ main to a program.

    made: generated files that the main includes, text by name
    headers: further headers; all headers in this folder are always available
    more: further arguments for Verilator
    level: optimisation level of the C++ compiler
    Raises RuntimeError with the end of the compiler's log.
    """
    args = [*ARGS, *more, *(COUNTING if counted() else ())]
    texts = {file.name: file.read_text() for file in (main, *CPP.glob("*.hpp"), *headers)}
    texts |= made | {"top.sv": without_initial(source)}

    def compile(folder: Path):
        report(COMPILING)
        for name, text in texts.items():
            (folder / name).write_text(text)
        _compile(folder, main.name, args, level)

    return kept_folder(KIND, [texts, args, level], compile) / "obj" / "Vtop"


def _compile(folder: Path, main: str, args: list[str], level: str) -> None:
    """Run Verilator and the C++ compiler in a folder; RuntimeError with the end of their log."""
    with shared(folder / "obj", environment(), args, level) as variables:
        program = shutil.which("verilator", path=variables["PATH"])
        done = subprocess.run(
            [program, *args, "top.sv", main],
            cwd=folder, env=variables, capture_output=True, text=True, check=False,
        )  # fmt: skip
    if done.returncode:
        log = (done.stdout + done.stderr).splitlines()[-LOG_LINES:]
        raise RuntimeError("\n".join([f"Verilator or g++ failed in {folder}", *log]))


@contextmanager
def shared(
    objects: Path, variables: dict[str, str], args: list[str], level: str
) -> Iterator[dict[str, str]]:
    """Share what all programs have in common: compiling it would take most of a small one's time.

    These are the objects of Verilator's own library, and its header, precompiled for each level of
    optimisation. They are made with the first program of each environment and arguments, and
    again when Verilator or the compiler is installed again: clang refuses a header precompiled
    from files that are newer now.

    objects: folder in which the program is compiled
    Yields the environment variables for compiling.
    """
    program = shutil.which("verilator", path=variables["PATH"])
    version = subprocess.run(
        [program, "--version"], env=variables, capture_output=True, check=False
    )
    made_from = [program, version.stdout, variables.get("MAKEFLAGS"), HEADER, args]
    made_from.append([Path(path).stat().st_mtime_ns for path in installed(program, variables)])
    kept = cache_root() / KIND / f"library-{digest(made_from)}"
    for folder in (kept, objects):
        folder.mkdir(parents=True, exist_ok=True)
    _copy(kept, objects)
    options = {}
    for name, its in ("OPT_FAST", level), ("OPT_SLOW", SLOW):
        write(header := kept / f"header{its}.h.fast", HEADER.encode())
        options[name] = f"{its} -include {header}"
    for kind in ("fast", "slow"):  # in place of headers precompiled for this program alone
        (objects / f"none.{kind}.gch").touch()
    own = {"VK_PCH_H": "none", "VK_PCH_I_FAST": "", "VK_PCH_I_SLOW": "", "OPT_GLOBAL": FAST}
    yield with_settings(variables, own | options)
    if (objects / "Vtop.mk").exists():
        _copy(objects, kept)
        for its in {level, SLOW}:
            _precompile(kept / f"header{its}.h.fast", objects, variables, its)


def _precompile(header: Path, objects: Path, variables: dict[str, str], level: str) -> None:
    """Precompile the header by the makefile of a compiled program, unless it is there already."""
    target = header.with_name(f"{header.name}.gch")
    if target.exists():
        return
    # Other processes may make it too; clang looks for the file that it was made from.
    scratch = header.with_name(f"{os.getpid()}{level}.h")
    scratch.write_text(HEADER)
    made = scratch.with_name(f"{scratch.name}.fast.gch")
    command = ["make", "-f", "Vtop.mk", f"OPT_FAST={level}", str(made)]
    subprocess.run(command, cwd=objects, env=variables, capture_output=True, check=False)
    if made.exists():
        made.replace(target)


def _copy(source: Path, target: Path) -> None:
    """Copy compiled objects of the library, dated into the future so that `make` keeps them."""
    for file in source.glob("verilated*.o"):
        if not (target / file.name).exists():
            scratch = target / f"{file.name}.{os.getpid()}"  # other processes may copy it too
            shutil.copy(file, scratch)
            os.utime(scratch, (later := time.time() + LATER, later))
            scratch.replace(target / file.name)
