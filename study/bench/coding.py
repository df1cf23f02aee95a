"""`splatcore bench coding`: sizes of model files by coding method (`spec.coded`)."""

import lzma
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from splatcore.model.formats.model_file import decode, encode, file_bytes, zstd
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.source import open_source
from splatcore.spec.config import Config
from splatcore.spec.packed import PackedModel

RAW_LZMA = {"format": lzma.FORMAT_RAW, "filters": [{"id": lzma.FILTER_LZMA1, "lc": 4, "pb": 0}]}
"""Raw LZMA; the high bits of the previous byte select its adaptive models."""


def shorter(compress: Callable[[bytes], bytes]) -> Callable[[bytes], bytes]:
    """Wrap a compressor to return its input if that is shorter."""
    return lambda part: min(compress(part), part, key=len)


def ideal(part: bytes) -> bytes:
    """As many (zero) bytes as an ideal range coder with known byte frequencies would need."""
    share = np.bincount(np.frombuffer(part, np.uint8)) / len(part)
    share = share[share > 0]
    return bytes(int(np.ceil(-len(part) * (share * np.log2(share)).sum() / 8)))


WAYS: dict[str, Callable[[PackedModel], bytes]] = {
    "memory_zstd": lambda model: zstd(model.image.tobytes()),
    "memory_lzma": lambda model: lzma.compress(model.image.tobytes()),
    "columns": partial(encode, differences=False, repeats=False),
    "differences": partial(encode, repeats=False),
    "copies": partial(encode, differences=False),
    "both": encode,
    "both_range_coder": partial(encode, compress=ideal),
    "both_lzma": partial(encode, compress=shorter(partial(lzma.compress, **RAW_LZMA))),
}
"""Coding methods: (model) → coded bytes, by name.

memory_…: the memory image, compressed as it is
columns, differences, copies, both: columns with zstd, without and with the steps of `spec.coded`
both_…: all steps, with another compressor
"""


def coding(
    config: Config, scenes: list[str], qualities: list[str], progress: Callable,
    reading: Reading = AS_STATED,
) -> list[dict]:  # fmt: skip
    """Measure all scenes in all qualities, one row each.

    progress: called with (done, total, label)
    """
    rows = []
    for scene in scenes:
        original = open_source(scene, reading).unpacked
        for quality in qualities:
            progress(len(rows), len(scenes) * len(qualities), f"{scene} {quality}")
            model = pack(original, config, quality=quality)[0]
            rows.append({"scene": Path(scene).name, "quality": quality} | measured(model))
    return rows


def measured(model: PackedModel) -> dict:
    """Sizes of a model by coding method, and seconds of coding and decoding."""
    sizes = {name: len(way(model)) for name, way in WAYS.items()}
    begin = time.perf_counter()
    data = encode(model)
    between = time.perf_counter()
    same = np.array_equal(decode(data, model.name), model.image)
    end = time.perf_counter()
    return {
        "gaussians": len(model), "sh_degree": model.format.sh_degree, "bytes": len(model.image),
        "file_bytes": len(file_bytes(model)), "bytes_by_way": sizes, "same": same,
        "encode_seconds": between - begin, "decode_seconds": end - between,
    }  # fmt: skip
