"""Bits of a packed model as plain integers, and models with changed bits."""

import numpy as np

from splatcore.spec.memory import HEADER
from splatcore.spec.packed import PackedModel, checksum


def bits(image: np.ndarray, byte: int, offset: int, width: int) -> int:
    """`width` bits from bit `offset` of byte `byte` on, as a plain integer."""
    word = int.from_bytes(image[byte : byte + (offset + width + 7) // 8 + 8].tobytes(), "little")
    return word >> offset & (1 << width) - 1


def signed(code: int, width: int) -> int:
    return code - (code >> width - 1 << width)


def aligned(value: int) -> int:
    """The next multiple of 64."""
    return -(-value // 64) * 64


def with_checksum(image: np.ndarray, name: str) -> PackedModel:
    """The model of an image, whose checksum is made to match."""
    place = HEADER.offset("checksum") // 8
    image[place : place + 4] = np.frombuffer(np.uint32(checksum(image)).tobytes(), np.uint8)
    return PackedModel(image, name)
