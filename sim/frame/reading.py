"""The options that decide how a scene is read and viewed, as one value."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from splatcore.model.formats.spz_axes import AXES
from splatcore.sim.common.choice import choices
from splatcore.sim.common.option import SCENE, option
from splatcore.spec.camera import NEAR_LIMITS, Camera
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.error import InputError

ANTIALIASED = {True: "--antialiased", False: "--no-antialiased"}
"""The option that overrides a scene's mark, by its value."""


@dataclass(frozen=True)
class Marks:
    """Marks that a scene file may lack, and the part of it to read; None: not given. Raises
    InputError for unknown axes and a negative level."""

    antialiased: bool | None = option(
        None,
        None,
        "Render with opacity compensation, for scenes trained with it. Default: as the file says.",
        "--antialiased/--no-antialiased",
        panel=SCENE,
    )
    axes: str | None = option(
        None,
        "RUB|RDF|…",
        "Directions of x, y and z in an SPZ file (also inside glTF) that does not state them, or "
        "in USD; RDF (right, down, front) as in a PLY. Default: RUB, SPZ's own; RDF for USD.",
        panel=SCENE,
    )
    lod: int | None = option(
        None,
        "N",
        "Level of detail of a streamed SOG (lod-meta.json). Default: 0, the finest.",
        panel=SCENE,
        min=0,
    )

    def __post_init__(self):
        if self.axes is not None:
            if self.axes.upper() not in AXES:
                raise InputError(f"--axes '{self.axes}': unknown; choose {choices(AXES)}")
            object.__setattr__(self, "axes", self.axes.upper())
        if self.lod is not None and self.lod < 0:
            raise InputError(f"--lod {self.lod}: is negative")


@dataclass(frozen=True)
class Reading(Marks):
    """Options on a scene; None: not given.

    A field that is added here is an option of every command that renders a scene.
    """

    near: float | None = option(
        None,
        "Z",
        f"Near plane: leave out Gaussians up to this depth. Default: {NEAR_PLANE:g}, as in 3DGS.",
        panel=SCENE,
        min=NEAR_LIMITS[0],
        max=NEAR_LIMITS[1],
    )

    @property
    def reading(self) -> "Reading":
        """These options alone, of a command that has more."""
        return Reading(self.antialiased, self.axes, self.lod, self.near)

    @property
    def options(self) -> tuple[str, ...]:
        """The given options, as on the command line."""
        axes = f"--axes {self.axes}" if self.axes else None
        lod = None if self.lod is None else f"--lod {self.lod}"
        near = None if self.near is None else f"--near {self.near:g}"
        return tuple(each for each in (ANTIALIASED.get(self.antialiased), axes, lod, near) if each)

    @property
    def near_plane(self) -> float:
        """The near plane of generated views."""
        return NEAR_PLANE if self.near is None else self.near

    def seen(self, cameras: Iterable[Camera]) -> list[Camera]:
        """Return cameras with the given near plane, or with their own."""
        if self.near is None:
            return list(cameras)
        return [replace(camera, near=self.near) for camera in cameras]

    def check_unpacked(self, name: str):
        """Raise InputError if an option was given that a packed model has fixed."""
        for given in replace(self, near=None).options:
            fixed = {"--axes": "axes", "--lod": "level of detail"}.get(given.split()[0], "mark")
            why = f"a packed model has its own {fixed}; repack the scene"
            raise InputError(f"{given}: {name}: {why}: splatcore pack SCENE {given} -o MODEL")


AS_STATED = Reading()
"""No options: everything as in the file."""
