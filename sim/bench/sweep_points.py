"""The machines that `splatcore bench sweep` compares: DEFAULT, PAPER, and one thing changed."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from itertools import product

from splatcore.sim.accuracy.points import width_of, with_width
from splatcore.spec.config import DEFAULT, FORMATS, PAPER, Config

LANES = 16  # of a rasterizer: the pixels of a block


@dataclass(frozen=True)
class Point:
    """A machine of the sweep. knob: what differs from DEFAULT, value: how much of it there is."""

    name: str
    knob: str
    value: str
    config: Config

    @property
    def fields(self) -> dict[str, object]:
        """Fields of `Config` that differ from DEFAULT's; as text if JSON has no word for them."""
        found = {}
        for field in fields(Config):
            value = getattr(self.config, field.name)
            if field.name != "name" and value != getattr(DEFAULT, field.name):
                found[field.name] = value if isinstance(value, int | str) else str(value)
        return found


WIDTHS = ("5/10", "7/10", "7/13", "8/20")
"""Bits of exponent and fraction of stages 0 and 1 beside DEFAULT's."""

KEYS = (17, 18, 19, 20)
"""Bits of a depth key beside DEFAULT's: each one less halves the octaves behind the near plane."""

RASTER_FORMATS = {
    "coarse": {field: format.coarse for field, format in FORMATS.items()},
    "weights -1 bit": {"weight": 10, "sum_fraction": 12},
    "fine": {field: format.fine for field, format in FORMATS.items()},
}
"""Formats of stage 3, together: a little less, one thing less, a little more."""

LIMITS, FAINT, ENDS = (4, 5, 6), (9, 11, 13), (7, 9)
"""2^−these: T from which on, and what a splat takes of it below which, it is too faint; T of which
the last splat takes all, beside DEFAULT's."""


def changed(knob: str, value: object, **changes) -> Point:
    """DEFAULT with something changed."""
    name = f"{knob} {value}"
    return Point(name, knob, str(value), replace(DEFAULT, name=name, **changes))


def points() -> Iterator[Point]:
    """All of them; InputError for one that Config refuses would be a mistake in this file."""
    yield Point("DEFAULT", "preset", "DEFAULT", DEFAULT)
    yield Point("PAPER", "preset", "PAPER", PAPER)
    for text in WIDTHS:
        config = with_width(text)
        changes = {
            field: getattr(config, field) for field in ("arithmetic", "depth", "screen_exponent")
        }
        yield changed("float", width_of(config), **changes)
    for bits in KEYS:
        yield changed("key", bits, sort_digits=(1,) * bits)
    for name, changes in RASTER_FORMATS.items():
        yield changed("raster format", name, **changes)
    for count in (1, 2, 8, 16):
        yield changed("lanes", count * LANES, rasterizers=count)
    for limit, below in product(LIMITS, FAINT):
        if (faint := (limit, below, DEFAULT.faint[-1])) != DEFAULT.faint:
            yield changed("faint", f"T 1/{1 << limit}, below 1/{1 << below}", faint=faint)
    for end in ENDS:
        name = f"the rest below 1/{1 << end}"
        yield changed("faint", name, faint=(*DEFAULT.faint[:2], end))
    yield changed("faint", "off", faint=())
    yield changed("PEs", 6, pes=6)
    for count in (1, 2, 4):
        yield changed("sub-sorters", f"{count}, OR-trees", sub_sorter="trees", sub_sorters=count)
    yield changed("port", "128 bits", port=128)
    yield changed("tile test", "3sigma", tile_test="3sigma")
    for tiles in (1, 2):
        yield changed("group", tiles, group=tiles)
