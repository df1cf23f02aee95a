"""Hosts in C and C++ that are compiled with the machine's headers and driver, and run."""

import subprocess
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from splatcore.spec.camera import Camera

STRICT = """
-O1 -Werror -Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wfloat-conversion -Wshadow
-Wcast-qual -Wcast-align=strict -Wdouble-promotion -Wduplicated-branches -Wduplicated-cond
-Wformat=2 -Wlogical-op -Wmissing-declarations -Wnull-dereference -Wpointer-arith
-Wredundant-decls -Wswitch-default -Wswitch-enum -Wundef -Wunused-macros -Wvla -Wwrite-strings
""".split()  # many warnings of gcc need some optimisation
LANGUAGES = {
    ".c": """gcc -std=c11 -Wbad-function-cast -Wjump-misses-init -Wmissing-prototypes
        -Wnested-externs -Wold-style-definition -Wstrict-prototypes""".split(),
    ".cc": """g++ -std=c++17 -Wextra-semi -Wold-style-cast -Woverloaded-virtual
        -Wzero-as-null-pointer-constant""".split(),
}
"""Compiler by suffix of a source, with all warnings that concern code of such a host."""


def compile_c(headers: Path, source: Path, *options: object):
    """Compile a source by its suffix, without any warning. headers: folder of register files."""
    command = [*LANGUAGES[source.suffix], *STRICT, f"-I{headers}", *options, source]
    subprocess.run(command, check=True)


@cache
def driver(headers: Path) -> list[Path]:
    """Compile the drivers in a folder; their objects."""
    sources = sorted(headers.glob("*.c"))
    objects = [source.with_suffix(".o") for source in sources]
    for source, made in zip(sources, objects, strict=True):
        compile_c(headers, source, "-c", "-o", made)
    return objects


def host_lines(headers: Path, main: str, suffix: str = ".c", with_driver: bool = True) -> list[str]:
    """Compile a host, link it with the driver and run it; the lines that it prints."""
    with TemporaryDirectory(prefix="splatcore") as name:
        host = Path(name) / f"host{suffix}"
        host.write_text(main)
        compile_c(headers, host, "-c", "-o", host.with_suffix(".o"))
        objects = [host.with_suffix(".o"), *(driver(headers) if with_driver else ())]
        program = host.with_suffix("")
        subprocess.run([LANGUAGES[suffix][0], *objects, "-lm", "-o", program], check=True)
        done = subprocess.run([program], capture_output=True, text=True, check=True)
        return done.stdout.splitlines()


def constants(numbers: Iterable[float]) -> str:
    """Numbers as exact constants of C."""
    return ", ".join(float(number).hex() for number in numbers)


def camera_fields(view: Camera, levels: bool = False) -> str:
    """Initial values of a `splatcore_camera`. levels: the machine has levels of detail"""
    rows = [f"{{{constants(row)}}}" for row in view.rotation]
    focal = constants([view.fx, view.fy, view.cx, view.cy])
    last = constants([view.near, *[view.lod_pixels] * levels])
    place = f"{{{', '.join(rows)}}}, {{{constants(view.translation)}}}, {last}"
    return f"{view.width}, {view.height}, {focal}, {place}"
