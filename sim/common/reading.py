"""Options on how a scene is read and seen, as one value."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from splatcore.model.formats.spz_axes import AXES
from splatcore.spec.camera import Camera
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.error import InputError

ANTIALIASED = {True: "--antialiased", False: "--no-antialiased"}
"""The option that overrides a scene's mark, by its value."""


@dataclass(frozen=True)
class Reading:
    """Options on a scene; each is None unless it was given.

    antialiased: overrides the scene's mark. axes: those of an SPZ file that states none, one of
    `AXES` in any case. near: near plane of all cameras, scene units. InputError for unknown axes.
    """

    antialiased: bool | None = None
    axes: str | None = None
    near: float | None = None

    def __post_init__(self):
        if self.axes is not None:
            if self.axes.upper() not in AXES:
                raise InputError(f"--axes '{self.axes}': unknown (there are {', '.join(AXES)})")
            object.__setattr__(self, "axes", self.axes.upper())

    @property
    def options(self) -> tuple[str, ...]:
        """The options that were given, as on the command line."""
        axes = f"--axes {self.axes}" if self.axes else None
        near = None if self.near is None else f"--near {self.near:g}"
        return tuple(each for each in (ANTIALIASED.get(self.antialiased), axes, near) if each)

    @property
    def near_plane(self) -> float:
        """The near plane of views that a command makes itself."""
        return NEAR_PLANE if self.near is None else self.near

    def seen(self, cameras: Iterable[Camera]) -> list[Camera]:
        """Cameras with the near plane that was given, or with their own."""
        if self.near is None:
            return list(cameras)
        return [replace(camera, near=self.near) for camera in cameras]

    def check_unpacked(self, name: str):
        """InputError for any option with a packed model, which holds what they decide on."""
        for option in replace(self, near=None).options:
            what = "axes" if option.startswith("--axes") else "mark"
            why = f"a packed model has its own {what}; repack the scene"
            raise InputError(f"{option}: {name}: {why}: splatcore pack SCENE {option} -o MODEL")


AS_STATED = Reading()
"""Everything as the file states it."""
