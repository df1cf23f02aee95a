"""The files in this folder: a scene, its camera and gsplat's picture; gsplat's conventions."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from splatcore.spec.camera import Camera
from splatcore.spec.convention import Convention
from splatcore.spec.scene import Scene

FOLDER = Path(__file__).parent

VERSIONS = {"torch": "2.13.0", "gsplat": "1.5.3"}
"""Packages that made the files; the extra `[outside]` pins the same versions."""

GSPLAT = Convention(
    alpha_max=0.999,
    pixel_centre=0.5,
    principal_point_shift=0.0,
)
"""Conventions of gsplat's CPU path. The background is black unless a stored scene has another one.

Source: gsplat 1.5.3, `cuda/_torch_impl.py`, and `cuda/csrc/RasterizeToIndices3DGS.cu` for the two
thresholds in a CUDA kernel. Equal to our defaults: the Jacobian's margin of 1.3 (if cx = width/2
and cy = height/2), the blur of 0.3, the colour offset, and the footprint: boxes of 3.33 σ along x
and y contain every pixel with alpha ≥ 1/255, because √(2·ln 255) = 3.329.
"""

ATTRIBUTES = ("position", "scale", "quaternion", "opacity", "sh")


@dataclass(frozen=True, eq=False)
class Case:
    """A scene to render. All numbers in `scene` are exact in float32."""

    scene: Scene
    camera: Camera  # cx = width/2, cy = height/2
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear RGB


@dataclass(frozen=True, eq=False)
class Stored:
    """A case and gsplat's result, calculated in float64 and stored in float32 (error < 2e-7)."""

    case: Case
    image: np.ndarray  # [H, W, 3] linear RGB
    transmittance: np.ndarray  # [H, W]
    versions: dict[str, str]


def save(stored: Stored) -> Path:
    """Write the file of `stored.case.scene.name`; its path."""
    scene, camera = stored.case.scene, stored.case.camera
    mark = {"antialiased": np.array(True)} if scene.antialiased else {}
    path = FOLDER / f"{scene.name}.npz"
    np.savez_compressed(
        path,
        **{name: getattr(scene, name).astype(np.float32) for name in ATTRIBUTES},
        size=np.array([camera.width, camera.height]),
        focal=np.array([camera.fx, camera.fy]),
        rotation=camera.rotation,
        translation=camera.translation,
        background=np.array(stored.case.background),
        image=stored.image.astype(np.float32),
        transmittance=stored.transmittance.astype(np.float32),
        **mark,
        **{name: np.array(version) for name, version in stored.versions.items()},
    )
    return path


def load(name: str) -> Stored:
    """Read a file written by `save`."""
    with np.load(FOLDER / f"{name}.npz") as file:
        field = dict(file)
    width, height = (int(side) for side in field["size"])
    fx, fy = (float(focal) for focal in field["focal"])
    pose = field["rotation"], field["translation"]
    camera = Camera(width, height, fx, fy, width / 2, height / 2, *pose, name)
    arrays = {key: field[key] for key in ATTRIBUTES}
    scene = Scene(**arrays, name=name, antialiased="antialiased" in field)
    case = Case(scene, camera, tuple(field["background"].tolist()))
    versions = {key: str(field[key]) for key in VERSIONS}
    return Stored(case, field["image"], field["transmittance"], versions)
