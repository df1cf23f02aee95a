"""Records between the parts of stages 0 and 1.

A chunk's values go to all parts that handle its points. Its last point is passed on even if it is
dropped (`kept` 0), so that each part sees the end of the chunk.
"""

from splatcore.spec.colour import CHANNELS, unscaled_colour_format
from splatcore.spec.config import Config
from splatcore.spec.depth import low_format
from splatcore.spec.frame import CAMERA
from splatcore.spec.memory import CHUNK, CHUNK_HEADER, EXPONENT_MAX
from splatcore.spec.number import Bits, Fixed
from splatcore.spec.programs import PROJECTED
from splatcore.spec.record import Format, Record

GAUSSIAN_BITS = 32
"""Width of a Gaussian's number in its model."""

PLACE_BITS = (CHUNK - 1).bit_length()
"""Width of a Gaussian's number in its chunk."""

NUMBER_BITS = GAUSSIAN_BITS - PLACE_BITS
"""Width of a chunk's number."""

BEATS_BITS = GAUSSIAN_BITS + 2
"""Width of a number of beats of attributes."""

EXPONENT = Fixed(EXPONENT_MAX.bit_length(), 0, signed=True)
"""An exponent of a model's header."""

AWAY = Fixed(CAMERA.integer + 1, 0, signed=True)
"""A component of the vector from the camera to a point, in grid steps."""

FETCH = Record("fetch", {"number": Bits(NUMBER_BITS), "count": Bits(PLACE_BITS + 1)})
"""A chunk whose points are to be read.

number: the chunk's number
count: number of points
"""

WANTED = Record("wanted", {"beat": Bits(BEATS_BITS), "count": Bits(2)})
"""A Gaussian's attributes to be read.

beat: first beat, counted from the model's first
count: beats, 1 … 3
"""


def values(config: Config, names: str) -> dict[str, Format]:
    """Return a field of `Config.arithmetic` for each name."""
    return {name: config.arithmetic for name in names.split()}


def culling_record(config: Config) -> Record:
    """Fields of a chunk for stage 0."""
    fields: dict[str, Format] = {"count": Bits(PLACE_BITS + 1)}
    if config.position == "chunk":
        fields |= {name: CHUNK_HEADER[name] for name in ("origin", "shift", "octant_end")}
    reach = "chunk_reach" if config.depth_interval else ""
    return Record("culling", fields | values(config, reach))


def placing_record(config: Config) -> Record:
    """Fields of a chunk for the guard band."""
    return Record("placing", values(config, "margin_x margin_y"))


def projecting_record() -> Record:
    """Fields of a chunk for stage 1.

    attributes: first beat of its attributes, counted from the model's first; half beats in small
        models
    harmonics, step: from the chunk's header
    """
    colour = {name: CHUNK_HEADER[name] for name in ("harmonics", "step")}
    return Record("projecting", {"attributes": Bits(BEATS_BITS)} | colour)


def chunk_record(config: Config) -> Record:
    """All fields of a chunk that is not skipped."""
    parts = (culling_record(config), placing_record(config), projecting_record(), FETCH)
    return Record("chunk", {part.name: part for part in parts})


def point_record(config: Config, coordinates: str) -> Record:
    """A point between the parts of stages 0 and 1.

    place: number in its chunk
    last: last point of the chunk
    kept: not dropped
    z_low: low bits of its depth (`spec.depth`)
    coordinates: its known camera coordinates, for example "x y z"
    ray_x, ray_y, ray_z: vector from the camera
    """
    flags = {"place": Bits(PLACE_BITS), "last": Bits(1), "kept": Bits(1)}
    fields = values(config, f"{coordinates} ray_x ray_y ray_z")
    return Record("point", flags | low_format(config) | fields)


def splat_record(config: Config) -> Record:
    """A projected Gaussian, in the units of `spec.programs`."""
    colour = config.arithmetic if config.colours == "array" else unscaled_colour_format(config)
    projected = values(config, PROJECTED[config.tile_test])
    return Record("splat", projected | dict.fromkeys(CHANNELS, colour) | low_format(config))
