"""The files of this folder: a scene, its camera and what gsplat made of them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

FOLDER = Path(__file__).parent

VERSIONS = {"torch": "2.13.0", "gsplat": "1.5.3"}
"""The packages that made the files; the extra `[outside]` pins the same."""

ATTRIBUTES = ("position", "scale", "quaternion", "opacity", "sh")


@dataclass(frozen=True, eq=False)
class Case:
    """A scene to render. Every number of `scene` is exact in float32."""

    scene: Scene
    camera: Camera  # cx = width/2, cy = height/2
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear RGB


@dataclass(frozen=True, eq=False)
class Stored:
    """A case and gsplat's result, calculated in float64 and kept in float32 (error < 2e-7)."""

    case: Case
    image: np.ndarray  # [H, W, 3] linear RGB
    transmittance: np.ndarray  # [H, W] what is left of the background
    versions: dict[str, str]


def save(stored: Stored) -> Path:
    """Writes the file of `stored.case.scene.name`."""
    scene, camera = stored.case.scene, stored.case.camera
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
        **{name: np.array(version) for name, version in stored.versions.items()},
    )
    return path


def load(name: str) -> Stored:
    """Reads what `save` wrote."""
    with np.load(FOLDER / f"{name}.npz") as file:
        field = dict(file)
    width, height = (int(side) for side in field["size"])
    fx, fy = (float(focal) for focal in field["focal"])
    pose = field["rotation"], field["translation"]
    camera = Camera(width, height, fx, fy, width / 2, height / 2, *pose, name)
    scene = Scene(**{key: field[key] for key in ATTRIBUTES}, name=name)
    case = Case(scene, camera, tuple(field["background"].tolist()))
    versions = {key: str(field[key]) for key in VERSIONS}
    return Stored(case, field["image"], field["transmittance"], versions)
