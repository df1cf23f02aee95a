"""Batches of entries for sub-sorters: keys of all kinds, including ties."""

from itertools import cycle

import numpy as np

from splatcore.spec.config import Config
from splatcore.study.bench.sort_rows import KEYS, random_keys


def close_keys(bits: int, count: int, random: np.random.Generator) -> np.ndarray:
    return random_keys(bits - 1, 1, random) + random.integers(0, 3, count, dtype=np.uint64)


def extreme_keys(bits: int, count: int, random: np.random.Generator) -> np.ndarray:
    return random.choice(np.array([0, (1 << bits) - 1], np.uint64), count)


KINDS = KEYS | {"close": close_keys, "extreme": extreme_keys}


def batches_of(config: Config, count: int, seed: int) -> list[np.ndarray]:
    """Batches of all kinds and sizes, first a full batch of each kind."""
    random = np.random.default_rng(seed)
    entries = config.sub_sorter_entries
    sizes = [entries] * len(KINDS) + [1, 2, 3, entries - 1]
    sizes += list(random.integers(1, entries + 1, count))
    return [
        keys_of(config.sort_key_bits, size, random)
        for keys_of, size in zip(cycle(KINDS.values()), sizes, strict=False)
    ]
