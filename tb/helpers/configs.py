"""Machines for tests: one table, so that equal machines have one name and are built once."""

from dataclasses import replace

from splatcore.spec.config import DEFAULT, PAPER, PRESETS, TINY, Config

PORTS = {port: replace(DEFAULT, name=f"PORT{port}", port=port) for port in (128, 256)}


def other_port(config: Config) -> Config:
    """The same machine with the other port width."""
    return replace(config, name=f"{config.name}_OTHER", port=128 if config.port == 256 else 256)


def wide_addresses(config: Config) -> Config:
    """The same machine with 64-bit addresses."""
    return replace(config, name=f"{config.name}_WIDE", address_bits=64)


ALPHA = replace(TINY, name="ALPHA", rgba=True)
"""A machine that writes alpha: its spans have 32 bytes, while those of TINY share beats."""

MAPS = (*PRESETS.values(), wide_addresses(DEFAULT), ALPHA)
"""Machines with register maps of all kinds."""

TREES = replace(TINY, sub_sorter="trees")

CHANGED = {
    # Keys: SHORT's do not cover all depths, and its groups are single tiles.
    "SHORT": (TINY, {"sort_digits": (1,) * 19, "group": 1}),
    "NARROW": (TINY, {"sort_digits": (1,) * 8}),
    # Tiles.
    "SQUARE": (TINY, {"tile_test": "3sigma"}),
    "SQUARE_HD": (DEFAULT, {"tile_test": "3sigma"}),
    "FP16": (PAPER, {"tile_test": "exact"}),
    # Rasterizers: FEW has two blocks for each one.
    "SINGLE": (DEFAULT, {"rasterizers": 1, "lanes": "block"}),
    "FOUR_BLOCKS": (DEFAULT, {"rasterizers": 4, "lanes": "block"}),
    "SIXTEEN": (DEFAULT, {"rasterizers": 16, "lanes": "block"}),
    "ONE": (TINY, {"rasterizers": 1, "group": 1}),
    "FEW": (TINY, {"rasterizers": 8, "group": 1, "logic": "fpga"}),
    # Lanes in quads: two sets of lanes, with alpha.
    "QUADS": (ALPHA, {"rasterizers": 4, "lanes": "quads"}),
    # Sub-sorters and merges.
    "four": (TREES, {"sub_sorters": 4, "merge_ways": 16, "sort_digits": PAPER.sort_digits}),
    "one": (TREES, {"sub_sorters": 1, "merge_ways": 2, "sort_digits": (1,) * 23}),
    "three": (
        TREES,
        {"sub_sorters": 3, "merge_ways": 8, "sub_sorter_entries": 32, "sort_digits": (5, 3)},
    ),
    "cascade_4": (TINY, {"sub_sorter_entries": 4, "sort_digits": (1,) * 8}),
    "cascade_512": (TINY, {"sub_sorter_entries": 512, "sort_digits": (1,) * 8}),
    "short": (PAPER, {"sub_sorter_entries": 32}),
    "largest": (PAPER, {"sub_sorter_entries": 512, "sort_digits": (1,) * 8}),
    "digits": (TINY, {"sort_digits": (4, 4)}),
    "uneven": (DEFAULT, {"sub_sorter_entries": 32, "sort_digits": (1, 4, 2, 3, 5)}),
    "pairs": (DEFAULT, {"sub_sorter_entries": 32, "sort_digits": (2,) * 11 + (1,)}),
}

MACHINES = {config.name: config for config in (DEFAULT, TINY, PAPER, ALPHA)} | {
    name: replace(base, name=name, **changes) for name, (base, changes) in CHANGED.items()
}
"""Presets and other machines, by name."""


def machines(names: str) -> dict[str, Config]:
    """Some machines, by their names in a row."""
    return {name: MACHINES[name] for name in names.split()}
