"""Machines of the soak tests: small ones of all kinds."""

from dataclasses import replace
from functools import cache

from splatcore.sim.machine.machine import Machine
from splatcore.spec.config import DEFAULT, PAPER, TINY, Config

SIDE = 80  # pixels, maximum image side of `small` machines

ROWS, COLUMNS = 32, 4096  # of the widest machine

TREES = {"sub_sorter": "trees", "sort_digits": (3, 3, 4, 4, 4, 5)}


@cache
def machine(config: Config) -> Machine:
    """Compile a machine, once per process."""
    return Machine(config)


def small(config: Config, **changes) -> Config:
    """A variant of a machine for small images."""
    return replace(config, width_max=SIDE, height_max=SIDE, **changes)


def graded(config: Config) -> bool:
    """Whether runs of a machine have models with levels of detail: only those with alpha, as such
    models are 8 to 30 times as large as others."""
    return config.levels and config.rgba


MACHINES: dict[str, Config] = {
    name: replace(config, name=f"SOAK-{name.replace(' ', '-')}")
    for name, config in {
        "tiny": TINY,
        "default": small(DEFAULT),
        "paper": small(PAPER, sub_sorter_entries=16),
        "1 rasterizer": replace(TINY, rasterizers=1, logic="fpga"),
        "4 rasterizers": replace(TINY, rasterizers=4),
        "8 rasterizers, 4 cycles": replace(TINY, rasterizers=8, port=256, pes=14),
        "16 rasterizers": small(DEFAULT, rasterizers=16, lanes="block", page=8),
        "group 1": replace(TINY, group=1),
        "group 4": small(TINY, group=4, port=256),
        "1 sub-sorter": replace(TINY, **TREES),
        "2 sub-sorters": replace(TINY, **TREES, sub_sorters=2),
        "4 sub-sorters": replace(TINY, **TREES, sub_sorters=4),
        "4096 columns": replace(TINY, width_max=COLUMNS, height_max=ROWS, group=4),
        "no early end": replace(TINY, early_termination=False, faint=()),
        "near plane only": replace(TINY, culling="near", tile_test="3sigma"),
        "degree 1": replace(TINY, sh_degree=1, levels=False, faint=(), port=256, pe_arrays=2),
        "2 rasterizers in quads": replace(TINY, lanes="quads"),
        "16 rasterizers in quads": small(DEFAULT, rasterizers=16, pes=9, levels=False, rgba=True),
        "alpha": replace(TINY, rgba=True),
    }.items()
}
"""Name → machine."""
