"""Gaussians in OpenUSD: `ParticleField3DGaussianSplat` in usda, usdc and usdz. Source: the schema
UsdVol of OpenUSD 26.03 and later, read by the package usd-core (extra [usd]).

A stage states which axis is up, but NVIDIA's usd-convert-gsplat 0.1.15 writes the numbers of a PLY,
y down, into stages with y up. So numbers are read in the axes of PLY unless the caller chooses
others. usd-core reads in a child process (`usd_arrays`): its faults and its memory stay there.
"""

import os
import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from splatcore.model.formats import file, usd_arrays
from splatcore.model.formats.file import input_error
from splatcore.model.formats.placed import merged, placed
from splatcore.model.formats.spz_axes import PLY_AXES, turned
from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.scene import Scene, sh_count

STARTS = (b"#usd", b"PXR-")
"""Beginnings of usda and usdc; a usdz is a zip, known by its suffix."""

MEMORY = 3 << 30
"""Address space of the child process in bytes, for a small file; usd-core itself takes 1 GB."""

MEMORY_PER_BYTE = 32  # more for each byte of the file; texts need most

SECONDS, BYTES_PER_SECOND = 60, 1 << 20
"""Time that the child process may take: for a small file, and the slowest accepted rate."""

SHAPES = {"position": (3,), "quaternion": (4,), "scale": (3,), "opacity": (), "sh": (3,)}
"""Field of a scene → shape of an entry of its attribute."""


def read(path: str | os.PathLike, axes: str | None = None) -> Scene:
    """Read all visible Gaussians of a USD stage at its first time, in the axes of PLY.

    axes: of the stage, one of `spz_axes.AXES` (default: RDF, the axes of PLY)
    """
    size = file.file_size(path)
    if find_spec("pxr") is None:
        raise input_error(path, "USD needs usd-core: pip install 'splatcore[usd]'")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "arrays.npz"
        _run(path, target, size)
        with file.reading(path), np.load(target) as held:
            arrays = dict(held)
    paths, hidden, up = (arrays.pop(name) for name in ("paths", "hidden", "up"))
    if not len(paths):
        hint = f" that is visible, and {hidden} hidden" if hidden else ""
        raise input_error(path, f"holds no {usd_arrays.CLASS}{hint}")
    parts = [
        _part({name: arrays.get(f"{k} {name}") for name in (*SHAPES, "degree", "matrix")}, where)
        for k, where in enumerate(f"{path}: {prim}" for prim in paths)
    ]
    scene = merged(parts)
    stated = f"the USD stage says {str(up).lower()} is up"
    by = "by --axes" if axes else "as usd-convert-gsplat writes it; choose others by --axes"
    notes = (*scene.notes, f"{stated}; read as {axes or PLY_AXES}, {by}")
    if hidden:
        notes += (f"{hidden} hidden {usd_arrays.CLASS} not read",)
    return replace(turned(scene, axes or PLY_AXES), name=os.fspath(path), notes=notes)


def _run(path: str | os.PathLike, target: Path, size: int) -> None:
    """Have the child process write a stage's arrays to `target`."""
    source, memory = os.path.abspath(path), MEMORY + MEMORY_PER_BYTE * size
    command = [sys.executable, "-P", usd_arrays.__file__, source, str(target), str(memory)]
    threads = dict.fromkeys(("PXR_WORK_THREAD_LIMIT", "OPENBLAS_NUM_THREADS"), "1")
    folder = {"TMPDIR": str(target.parent)}  # usd-core writes a report there if it crashes
    options = {"capture_output": True, "text": True, "errors": "replace"}
    seconds = SECONDS + size // BYTES_PER_SECOND
    with file.reading(path, "usd-core cannot read it"):
        try:
            done = subprocess.run(
                command, env=os.environ | threads | folder, timeout=seconds, **options
            )
        except subprocess.TimeoutExpired:
            raise input_error(path, f"usd-core takes more than {seconds} seconds") from None
    if done.returncode:
        reason = done.stdout.replace(f"@{source}@", "").replace(f"{source}:", "line ").strip()
        reason = re.sub(r"pxrInternal_\w+?::", "", reason)[:200]
        crash = f"it crashed with status {done.returncode}"
        raise input_error(path, f"usd-core cannot read it ({reason or crash})")


def _part(stored: dict[str, np.ndarray | None], where: str) -> Scene:
    """The Gaussians of a prim, placed in the stage."""
    if stored["position"] is None:
        raise input_error(where, "'positions' is missing")
    count, degree, notes = len(stored["position"]), int(stored["degree"]), []
    if degree < 0:
        raise input_error(where, f"SH degree {degree} is not supported")
    if degree > SH_DEGREE_MAX:
        notes.append(f"harmonics above degree {SH_DEGREE_MAX} are not used")

    def values(name: str, per: int, *default: float) -> np.ndarray:
        """Rows of an attribute, `per` for each Gaussian; the default as the schema says, if it is
        missing or too short."""
        array, attribute = stored[name], usd_arrays.ARRAYS[name]
        if array is not None and array.shape[1:] != SHAPES[name]:
            raise input_error(where, f"'{attribute}' has entries of shape {array.shape[1:]}")
        if array is not None and len(array) < per * count:
            notes.append(f"'{attribute}' has {len(array)} entries, not {per * count}: not used")
        if array is None or len(array) < per * count:
            return np.tile(np.array(default, np.float64), (count, 1))
        return array[: per * count].reshape(count, -1)

    position = values("position", 1)
    quaternion = values("quaternion", 1, 0, 0, 0, 1)[:, [3, 0, 1, 2]]
    scale = values("scale", 1, 1, 1, 1)
    opacity = values("opacity", 1, 1)[:, 0]
    sh = values("sh", (degree + 1) ** 2, 0, 0, 0).reshape(count, -1, 3)
    arrays = position, scale, quaternion, opacity, sh[:, : sh_count(SH_DEGREE_MAX)]
    scene = file.linear_scene(where, *arrays, tuple(notes))
    return placed(scene, stored["matrix"], where)
