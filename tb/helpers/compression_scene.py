"""A scene for tests of compression, a quick recipe, and an empty callback."""

from dataclasses import replace

import numpy as np

from splatcore.model.compress.recipe import Recipe
from splatcore.model.generate.generate import generate
from splatcore.spec.scene import Scene

RECIPE = Recipe(schedule=(0.3, 0.2), steps=6, distill_steps=4, quantize_steps=6)
SIZE = (96, 64)


def nothing(*_):
    """A progress callback that does nothing."""


def noted(monkeypatch, module, name: str) -> list[tuple]:
    """Arguments (by position) of each call of a module's function, from now on."""
    calls, right = [], getattr(module, name)

    def call(*given, **options):
        calls.append(given)
        return right(*given, **options)

    monkeypatch.setattr(module, name, call)
    return calls


def garden_with_harmonics(count: int = 700, strength: float = 0.05, seed: int = 1) -> Scene:
    """A garden with harmonics up to degree 3."""
    garden, rng = generate("garden", count), np.random.default_rng(seed)
    more = rng.normal(0, strength, (count, 16 - garden.sh.shape[1], 3))
    return replace(garden, sh=np.concatenate([garden.sh, more], axis=1))
