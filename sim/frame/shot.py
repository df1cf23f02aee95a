"""A frame to render, as one value: scene, camera, machine and packing, and what follows from them.

`ENGINES[name](shot)` in `sim.frame.engines` renders it; `judge(frame, shot)` compares the picture
with the reference's of the packed model ("machine") and of the original scene ("scene").
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatcore.sim.common.output import progress_bar
from splatcore.sim.frame.metric import LEVELS, Difference, differences, psnr
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.source import (
    Source,
    camera_beside,
    check_fits,
    open_camera,
    open_source,
    opened,
)
from splatcore.spec.camera import Camera
from splatcore.spec.colour import background_codes
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.convention import SPLATCORE, Convention
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

if TYPE_CHECKING:  # they import numba and Amaranth
    from splatcore.sim.frame.choose import Packed
    from splatcore.sim.machine.machine import Job

ENGINES = ("reference", "golden", "rtl")
"""Float64 reference, bit-accurate golden model, simulated hardware: see `engines.ENGINES`."""

Bar = Callable[[str], AbstractContextManager]
"""Shows the progress of a step with this label: yields advance(done, total, label)."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame to render.

    source: the opened scene or packed model
    camera: the view
    config: the machine
    quality: packing of a scene; None: the smallest that is good enough in this view
    convention: the reference's; its background is also the machine's
    rgba: whether pictures have alpha, and no background
    bar: shows the progress of packing and rendering
    """

    source: Source
    camera: Camera
    config: Config = DEFAULT
    quality: str | None = None
    convention: Convention = SPLATCORE
    rgba: bool = False
    bar: Bar = progress_bar

    @classmethod
    def open(
        cls, scene: str, camera: str | None = None, size: str | None = None,
        reading: Reading = AS_STATED, **more,
    ) -> "Shot":  # fmt: skip
        """Open a scene or model and its camera, as options name them. more: other fields"""
        with progress_bar(f"reading {scene}"):
            source = open_source(scene, reading)
            shot = cls(source, open_camera(camera, size, source), **more)
            source.seen_by(shot.camera)
        return shot

    def __reduce__(self):
        """Pickle the scene's name: another process opens it, once for all its frames."""
        source = self.source.name, self.source.reading
        more = self.camera, self.config, self.quality, self.convention, self.rgba
        return _reopened, (source, *more)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture."""
        return self.camera.width, self.camera.height

    def check_fits(self):
        """Raise InputError if the picture is too large for the machine."""
        check_fits(self.config, *self.size)

    @property
    def packed(self) -> "Packed | None":
        """The packing of the scene, shared by all frames that are packed alike; None for a model.

        The losses of packing are noted."""
        source, view = self.source, self.camera
        if source.scene is None:
            return None
        from splatcore.model.pack.pack import packing_key
        from splatcore.sim.frame.choose import packed

        key = packing_key(self.config), self.quality or (view.name, view.width, view.height)
        if key not in source.packings:
            source.check_need("packing", source.scene)
            with self.bar("packing") as advance:
                found = packed(
                    source.scene, self.config, view, self.quality,
                    lambda step: advance(0, None, step),
                )  # fmt: skip
            source.packings[key] = source.packings[key[0], found.quality] = found
            for line in found.report.notes:
                source.note(line)
        return source.packings[key]

    @property
    def model(self) -> PackedModel:
        """The model that the machine renders. It may be empty."""
        return self.source.model if self.packed is None else self.packed.model

    @property
    def frame(self) -> tuple[PackedModel, Camera, tuple[int, int, int], bool]:
        """Model, camera, background (codes of `spec.colour.colour_format`) and `rgba`."""
        background = background_codes(self.config, self.convention.background)
        return self.model, self.budgeted, background, self.rgba

    @cached_property
    def budgeted(self) -> Camera:
        """The camera, with the level of detail that --max-gaussians asks for."""
        most = self.source.reading.max_gaussians
        if most is None or not self.model.levels:
            return self.camera
        from splatcore.golden.levels import pixels_for
        from splatcore.spec.renderable import check_renderable

        check_renderable(self.config, self.model)
        pixels = pixels_for(self.config, self.model, self.camera, most)
        self.source.note(f"camera {self.camera.name}: --lod-pixels {pixels:.4g}")
        return replace(self.camera, lod_pixels=pixels)

    @property
    def job(self) -> "Job":
        """The frame as the simulated machine takes it."""
        from splatcore.sim.machine.machine import Job

        return Job(*self.frame)

    @cached_property
    def reference(self) -> np.ndarray:
        """The reference's 8-bit picture of the packed model."""
        return self._exact("drawn", "model", self.model)

    @cached_property
    def truth(self) -> np.ndarray | None:
        """The reference's 8-bit picture of the original scene; None for a packed model."""
        if self.source.scene is None:
            return None
        return self._exact("exact", "scene", self.source.drawn)

    def _exact(self, name: str, of: str, drawn: Scene | PackedModel) -> np.ndarray:
        """Render by the reference, unless packing has judged this view by the same picture."""
        plain = self.convention == SPLATCORE and not self.rgba
        if plain and getattr(self.packed, "camera", None) is self.camera:
            return getattr(self.packed, name)
        self.source.check_need("reference", drawn)
        from splatcore.golden.reference import render

        with self.bar(f"rendering the {of} by the reference") as advance:
            return render(drawn, self.camera, self.convention, advance, self.rgba).pixels

    @property
    def truths(self) -> dict[str, np.ndarray]:
        """The pictures that a machine's is compared with: "machine", and "scene" of a scene."""
        found = {"machine": self.reference, "scene": self.truth}
        return {name: pixels for name, pixels in found.items() if pixels is not None}

    @property
    def packing_size(self) -> dict[str, str | float] | None:
        """Quality and bytes per Gaussian of the packed scene; None for a packed model."""
        if self.packed is None:
            return None
        size = self.model.bytes_per_gaussian
        return {"quality": self.packed.quality, "bytes_per_gaussian": size}

    @property
    def packing(self) -> dict[str, str | float | None] | None:
        """`packing_size`, and the PSNR in dB of the reference's pictures, model against scene."""
        if self.packed is None:
            return None
        db = psnr(self.reference / LEVELS, self.truth / LEVELS)
        return self.packing_size | {"psnr_db_packing": db}

    @property
    def packing_line(self) -> str:
        """`packing` as a line of text."""
        quality, size, db = self.packing.values()
        loss = "equal" if db is None else f"{db:.2f} dB"
        size = f"{size:.2f} bytes per Gaussian"
        return f"packed as {quality}: {size}, packing {loss} against the scene as trained"


def judge(frame, shot: Shot) -> dict[str, Difference]:
    """Compare an engine's frame with the reference's pictures; return the differences by name."""
    return differences(frame.pixels, shot.truths)


def _reopened(source: tuple[str, Reading], *more) -> Shot:
    return Shot(opened(*source), *more)


@dataclass(frozen=True)
class View:
    """A scene and one of its cameras, by name: the task of a campaign, which opens it.

    scene: a file or the name of a generated scene
    camera: ID in the camera file next to the scene; "": the first camera, else a generated view
    size: WxH; None: the camera's own
    file: value of --camera, instead of the file next to the scene
    quality: packing; None: the smallest that is good enough
    reading: how the scene is read
    """

    scene: str
    camera: str = ""
    size: str | None = None
    file: str | None = None
    quality: str | None = None
    reading: Reading = AS_STATED

    @property
    def name(self) -> str:
        """A key of everything that decides on the picture except the size; names its results."""
        name = Path(self.scene).name + (f":{self.camera}" if self.camera else "")
        words = name, self.quality, *self.reading.options
        return " ".join(word for word in words if word)

    @cached_property
    def camera_text(self) -> str | None:
        """The equivalent value of --camera; None: no camera file."""
        path = self.file or camera_beside(self.scene)
        if self.camera and path is None:
            raise InputError(f"--cameras {self.camera}: {self.scene} has no camera file")
        return f"{path}:{self.camera}" if self.camera else path

    def open(self, config: Config = DEFAULT, source: Source | None = None) -> Shot:
        """Return its frame for a machine. source: the scene, if it is open already"""
        if source is None:
            return Shot.open(
                self.scene, self.camera_text, self.size, self.reading,
                config=config, quality=self.quality,
            )  # fmt: skip
        camera = open_camera(self.camera_text, self.size, source)
        source.seen_by(camera)
        return Shot(source, camera, config, self.quality)
