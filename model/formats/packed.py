"""Files of packed models; `spec.packed` defines their content."""

from pathlib import Path

import numpy as np

from splatcore.spec.error import InputError
from splatcore.spec.memory import MAGIC
from splatcore.spec.packed import PackedModel


def is_packed(path: str | Path) -> bool:
    """True if the file begins as a packed model does."""
    try:
        with open(path, "rb") as file:
            return int.from_bytes(file.read(4), "little") == MAGIC
    except OSError:
        return False


def read_model(path: str | Path) -> PackedModel:
    """A packed model from a file; InputError names the file and the field."""
    try:
        image = np.fromfile(path, np.uint8)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return PackedModel(image, str(path))
