"""What a report measures: scenes, size and machine, from the command line or from a result."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.common.scenes import FOLDER, SUFFIXES, VARIABLE, camera_beside
from splatcore.sim.common.source import VIEW_SIZE
from splatcore.spec.config import DEFAULT
from splatcore.spec.error import InputError

GENERATED, GENERATED_SIZE = "garden", "640x360"
"""What is measured where there is no folder of scenes."""

USUAL_SIZE = "x".join(map(str, VIEW_SIZE))
"""Of a view, if nothing else is asked for."""


@dataclass(frozen=True)
class Options:
    """What is measured; None where the command line says nothing."""

    scenes: tuple[str, ...] = ()
    size: str | None = None
    preset: str | None = None

    def resolved(self) -> "Options":
        """What is measured if the command line says nothing."""
        if self.scenes or place().is_dir():
            return self
        return replace(self, scenes=(GENERATED,), size=self.size or GENERATED_SIZE)

    def words(self, takes: Iterable[str]) -> list[str]:
        """Arguments for a command that takes some of them."""
        found = []
        if "scenes" in takes:
            found += self.scenes
        if "scene" in takes:
            found += one_scene(self.scenes[0] if self.scenes else first_scene())
        if "size" in takes and self.size:
            found += ["--size", self.size]
        if "preset" in takes and self.preset:
            found += ["--preset", self.preset]
        return found


def place() -> Path:
    """The folder of scenes; it need not be there."""
    return Path(os.environ.get(VARIABLE, FOLDER))


def first_scene() -> str:
    """The first scene of that folder."""
    paths = [path for path in place().iterdir() if path.suffix.lower() in SUFFIXES]
    if not paths:
        raise InputError(f"{place()}: holds no scene ({', '.join(SUFFIXES)})")
    return str(min(paths))


def one_scene(scene: str) -> list[str]:
    """A scene and its first camera, as commands for a single view take them."""
    camera = camera_beside(scene)
    return [scene, "--camera", camera] if camera else [scene]


def said(facts: dict) -> Options:
    """What a result was measured with, as far as it is no default; of files it has no folders."""
    size, preset = facts.get("size"), facts.get("preset")
    size = "x".join(map(str, size)) if isinstance(size, list) else size
    scenes = [facts.get("scene"), *(row.get("scene") for row in facts.get("rows", ()))]
    generated = dict.fromkeys(scene for scene in scenes if scene in GENERATORS)
    return Options(
        tuple(generated), None if size == USUAL_SIZE else size,
        None if preset == DEFAULT.name else preset,
    )  # fmt: skip
