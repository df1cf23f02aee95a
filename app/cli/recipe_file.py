"""Recipe files of `compress`: how a scene is pruned and fine-tuned, as TOML (docs/compression.md).

steps = 1400          # a field of `Recipe` or of `Pictures`
schedule = [0.4, 0.4]
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from types import NoneType
from typing import get_args, get_type_hints

from splatcore.model.compress.recipe import TARGETS, Recipe
from splatcore.spec.error import InputError
from splatcore.spec.preset import check_keys, read_table, typed
from splatcore.study.compression.run import BESIDE_SHARE


@dataclass(frozen=True)
class Pictures:
    """The pictures to learn from."""

    views: int = 480  # to render, without --images
    beside: float = BESIDE_SHARE  # share of them off the path of --cameras
    scale: float = 1.0  # of the sides of photographs
    hold_out: int = 7  # every so many photographs one is only measured; 0: none

    def __post_init__(self):
        for name, low, high in (
            ("views", 1, None), ("beside", 0, 1), ("scale", 1e-3, 1), ("hold_out", 0, None),
        ):  # fmt: skip
            value = getattr(self, name)
            if not (low <= value and (high is None or value <= high)):
                limits = f"in {low:g} … {high}" if high else f"{low} or more"
                raise InputError(f"--{name.replace('_', '-')}: {value:g} is not {limits}")


KEYS = {
    name: kind
    for group in (Recipe, Pictures)
    for name, kind in get_type_hints(group).items()
    if name not in TARGETS.values()
}
"""Keys of a recipe file and their types."""


def read_recipe(path: str | None, targets: dict[str, float | None]) -> tuple[Recipe, Pictures]:
    """Return the recipe of a file, else the default, with a target.

    Raises InputError, naming file and key, for an unknown key or a wrong value.
    """
    table = read_table(path) if path else {}
    check_keys(str(path), table, KEYS)
    values = {key: typed(_plain(KEYS[key]), table[key], f"{path}: {key}") for key in table}
    own = {field.name for field in fields(Pictures)} & set(values)
    with named(path):
        pictures = Pictures(**{name: values.pop(name) for name in own})
        return Recipe(**values, **targets), pictures


@contextmanager
def named(path: str | None) -> Iterator[None]:
    """Name the file and the key in errors of values that a recipe file has."""
    try:
        yield
    except InputError as error:
        text = re.sub(r"--([a-z-]+)", _key, str(error))
        raise InputError(f"{path}: {text}" if path and text != str(error) else text) from None


def _key(option: re.Match) -> str:
    key = option[1].replace("-", "_")
    return key if key in KEYS else option[0]


def _plain(kind: type) -> type:
    """Return the type of a key without None, which TOML does not have."""
    kinds = [each for each in get_args(kind) if each is not NoneType]
    return kinds[0] if NoneType in get_args(kind) else kind
