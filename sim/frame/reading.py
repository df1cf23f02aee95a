"""The options that decide how a scene is read and viewed, as one value."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

from splatcore.model.formats.spz_axes import AXES
from splatcore.sim.common.choice import choices
from splatcore.sim.common.option import SCENE, option
from splatcore.spec.camera import LOD_MAX, NEAR_LIMITS, Camera
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

    lod_pixels: float | None = option(
        None,
        "PX",
        "Of a model with levels of detail: draw coarser Gaussians where they are up to about PX "
        "pixels off. Default: 0, the finest level.",
        panel=SCENE,
        min=0,
        max=LOD_MAX,
    )
    max_gaussians: int | None = option(
        None,
        "N",
        "The same, by the smallest PX with which at most N Gaussians are read.",
        panel=SCENE,
        min=1,
    )

    def __post_init__(self):
        super().__post_init__()
        if self.lod_pixels is not None and self.max_gaussians is not None:
            raise InputError("use --lod-pixels or --max-gaussians, not both")

    @property
    def reading(self) -> "Reading":
        """These options alone, of a command that has more."""
        return Reading(**{field.name: getattr(self, field.name) for field in fields(Reading)})

    @property
    def options(self) -> tuple[str, ...]:
        """The given options, as on the command line."""
        axes = f"--axes {self.axes}" if self.axes else None
        lod = None if self.lod is None else f"--lod {self.lod}"
        views = {"near": self.near, "lod-pixels": self.lod_pixels}
        given = [f"--{name} {value:g}" for name, value in views.items() if value is not None]
        given += [f"--max-gaussians {self.max_gaussians}"] * (self.max_gaussians is not None)
        found = ANTIALIASED.get(self.antialiased), axes, lod, *given
        return tuple(each for each in found if each)

    @property
    def near_plane(self) -> float:
        """The near plane of generated views."""
        return NEAR_PLANE if self.near is None else self.near

    def seen(self, cameras: Iterable[Camera]) -> list[Camera]:
        """Return cameras with the given near plane and level of detail, or with their own."""
        given = {name: getattr(self, name) for name in ("near", "lod_pixels")}
        given = {name: value for name, value in given.items() if value is not None}
        return [replace(camera, **given) for camera in cameras] if given else list(cameras)

    def check_unpacked(self, name: str):
        """Raise InputError if an option was given that a packed model has fixed."""
        for given in replace(self, near=None, lod_pixels=None, max_gaussians=None).options:
            fixed = {"--axes": "axes", "--lod": "level of detail"}.get(given.split()[0], "mark")
            why = f"a packed model has its own {fixed}; repack the scene"
            raise InputError(f"{given}: {name}: {why}: splatcore pack SCENE {given} -o MODEL")


AS_STATED = Reading()
"""No options: everything as in the file."""
