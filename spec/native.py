"""Inner loops in C++: compiled at their first call, kept in the user's cache, called on arrays."""

import ctypes
import os
import platform
import shutil
import subprocess
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from threading import Lock

import numpy as np

from splatcore.spec.cache import kept_folder
from splatcore.spec.error import InputError

CLANG = ("clang++", *(f"clang++-{version}" for version in range(22, 13, -1)))
"""Names of clang."""

FLAGS = "-std=c++17 -O3 -march=native -fPIC -shared -ffp-contract=off".split()
FLAGS += "-fno-math-errno -fno-trapping-math -fwrapv".split()
"""Every operation of floating point rounds once, as in numpy."""

C_TYPES = {np.dtype(np.int32): "int32_t", np.dtype(np.int64): "int64_t", np.dtype(float): "double"}
SCALARS = {int: ctypes.c_int64, float: ctypes.c_double}

LOG_LINES = 40

FILE = "library.so"


def clang() -> str | None:
    """Return the path of clang; None if it is missing or the user has set CXX."""
    return None if "CXX" in os.environ else next(filter(None, map(shutil.which, CLANG)), None)


def compiler() -> str:
    """Return the path of g++ (a quarter faster here), of clang, or of the user's CXX; raise
    InputError if there is none."""
    name = os.environ.get("CXX", "g++")
    if found := shutil.which(name) or clang():
        return found
    raise InputError(f"{name}: is missing; install a C++ compiler, or name one by CXX")


def processor() -> str:
    """Return what `-march=native` depends on."""
    try:
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return "\n".join(line for line in lines if line.startswith(("model", "flags", "Features")))


class Library:
    """A C++ file with the functions of a module.

    source: the file; it includes "made.hpp"
    constants: numbers, and tuples of them, that made.hpp defines
    structs: dtypes of records that it defines; their fields are of `C_TYPES` or earlier structs
    base: a library whose file comes before this one's, with its constants and structs
    """

    def __init__(
        self,
        source: Path,
        constants: Mapping,
        structs: Mapping[str, np.dtype],
        base: "Library | None" = None,
    ):
        lines, types = [base.made if base else "#include <cstdint>"], dict(C_TYPES)
        for name, value in constants.items():
            many = isinstance(value, tuple)
            text = f"{{{', '.join(map(str, value))}}}" if many else str(value)
            lines.append(f"constexpr int64_t {name}{'[]' * many} = {text};")
        for name, dtype in structs.items():
            fields = (f"{types[dtype[field]]} {field};" for field in dtype.names)
            lines.append(f"struct {name} {{ {' '.join(fields)} }};")
            types[dtype] = name
            lines.append(f"static_assert(sizeof({name}) == {dtype.itemsize});")
        self.sources = [*(base.sources if base else ()), source]
        self.made, self.lock = "\n".join([*lines, ""]), Lock()

    def function(self, name: str, *kinds, result: type | None = None) -> Callable:
        """Return a function that runs without Python's lock.

        kinds: of its arguments: the dtype of an array, which must be contiguous, int (int64_t) or
            float (double)
        result: kind of its result
        """
        types = [SCALARS.get(k) or np.ctypeslib.ndpointer(k, flags="C") for k in kinds]
        found = []

        def call(*args):
            if not found:
                # As a whole: to set argtypes while another thread calls the function would crash.
                with self.lock:
                    if not found:
                        function = getattr(self._loaded, name)
                        function.argtypes, function.restype = types, SCALARS.get(result)
                        found.append(function)
            return found[0](*args)

        return call

    @cached_property
    def _loaded(self) -> ctypes.CDLL:
        program, texts = compiler(), [source.read_text() for source in self.sources]
        key = [*texts, self.made, program, Path(program).stat().st_mtime_ns, FLAGS, processor()]

        def compile(folder: Path):
            (folder / "made.hpp").write_text(self.made)
            (folder / "whole.cpp").write_text("\n".join(texts))
            command = [program, *FLAGS, "-I.", "-o", FILE, "whole.cpp"]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            if done.returncode:
                log = done.stderr.splitlines()[-LOG_LINES:]
                raise RuntimeError("\n".join([f"{program} failed on {self.sources[-1]}", *log]))

        return ctypes.CDLL(str(kept_folder("native", key, compile) / FILE))
