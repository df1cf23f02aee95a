"""Compiles a Verilog module and the C++ that drives it to a program, by Verilator, once."""

import os
import shutil
import subprocess
from functools import partial
from pathlib import Path

from splatcore.sim.common.cache import cache_root, digest, kept_folder
from splatcore.sim.rtl.verilator import environment

KIND = "streams"  # the folder of compiled simulations among what is kept
CPP = Path(__file__).parent  # the folder of the C++

SPLIT = ["--output-split", "200000", "--output-split-cfuncs", "1000"]
"""Few files of short functions: each file costs the C++ compiler the headers, and a function more
time than its length."""

ARGS = [
    "--cc", "--exe", "--build", "--build-jobs", "2", "-O3", "--x-assign", "fast", "-Wno-fatal",
    "--assert", *SPLIT, "--top-module", "top", "-Mdir", "obj", "-CFLAGS", "-I..",
]  # fmt: skip

QUICK, FAST = "-O1", "-O2"
"""Levels of the C++ compiler: compiled in two thirds of the time, or a tenth faster afterwards."""

LOG_LINES = 40


def build(
    source: str,
    main: Path,
    headers: list[Path],
    made: dict[str, str],
    more: tuple[str, ...] = (),
    level: str = QUICK,
) -> Path:
    """The program of a Verilog module `top` and a C++ main.

    headers: files that the main includes. made: further ones, as text by their names. more:
    arguments for Verilator. level: of the C++ compiler. Raises RuntimeError with the end of the
    compiler's log.
    """
    args = [*ARGS, *more]
    texts = {file.name: file.read_text() for file in (main, *headers)} | made | {"top.sv": source}

    def compile(folder: Path):
        for name, text in texts.items():
            (folder / name).write_text(text)
        _compile(folder, main.name, args, level)

    return kept_folder(KIND, [texts, args, level], compile) / "obj" / "Vtop"


def _compile(folder: Path, main: str, args: list[str], level: str) -> None:
    """Run Verilator and the C++ compiler in a folder; RuntimeError with the end of their log.

    Most of the time would go into Verilator's own library, the same for all: it is compiled once.
    """
    variables = environment()
    run = partial(subprocess.run, env=variables, capture_output=True, text=True, check=False)
    program = shutil.which("verilator", path=variables["PATH"])
    version = run([program, "--version"]).stdout
    made_from = [program, version, variables.get("MAKEFLAGS"), args]
    library, objects = cache_root() / KIND / f"library-{digest(made_from)}", folder / "obj"
    for made in (library, objects):
        made.mkdir(exist_ok=True)
    _copy(library, objects)
    there = [f"-o {file.name}" for file in objects.glob("verilated*.o")]
    flags = " ".join([f"OPT_FAST={level}", *there])
    done = run([program, *args, "-MAKEFLAGS", flags, "top.sv", main], cwd=folder)
    if done.returncode:
        log = (done.stdout + done.stderr).splitlines()[-LOG_LINES:]
        raise RuntimeError("\n".join([f"Verilator or g++ failed in {folder}", *log]))
    _copy(objects, library)


def _copy(source: Path, target: Path) -> None:
    """Copy what is compiled of the library."""
    for file in source.glob("verilated*.o"):
        if not (target / file.name).exists():
            scratch = target / f"{file.name}.{os.getpid()}"  # others may be copying it too
            shutil.copy(file, scratch)
            scratch.replace(target / file.name)
