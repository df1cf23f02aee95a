"""The packed model in DRAM: records, their order, their addresses.

    header │ chunk headers │ positions │ attributes │ colour codebook │ SH codebook

Every part begins at a multiple of `ALIGNMENT`. Gaussians are stored in chunks of `CHUNK` along the
Morton curve. A coordinate is an integer on the model's grid: the chunk's origin plus an offset of
`OFFSET_BITS` shifted left by the chunk's shift for that axis, times 2^position_exponent:

    coordinate = (origin + (offset << shift)) · 2^position_exponent

so adding is exact and multiplying by the step is a change of exponent. Within a chunk, Gaussians
are ordered by octant (the top bits of the three offsets, x lowest), so these bits follow from a
Gaussian's place and the header's octant ends. Only the rest is stored: 45 bits per Gaussian (27 in
small models, whose offsets end in zeros). With absolute positions (`PAPER`) a coordinate is stored
as a float, the grid's step is the smallest float, and of a chunk header only the reach has meaning.

The first beat of a Gaussian's attributes holds L, the lower-triangular factor of the 3D covariance
L·Lᵀ, times 2^−factor_exponent (its diagonal is never negative and has no sign bit), −log2(opacity),
and its colour, in one of two ways (`spec.colour` has the arithmetic):

- Codebooks (compact models, degree 0 or 1): one index per stage. The sum of one entry per stage,
  times 2^E of degree 0, is the original renderer's SH0·C0 + 0.5. The SH entries sum to the 3×3
  matrix G (times 2^E of degree 1) in colour + G·direction, with the unit direction from camera to
  Gaussian: the degree-1 harmonics with their constants multiplied in.
- Steps (all index bits 0): the base in 9 bits per channel. Harmonics follow in further beats; the
  chunk's header has their number and layout (`spec.colour.LAYOUTS`), and the steps.

The attributes of one chunk follow the attributes of the chunk before.

Small models have codebooks and half a beat of attributes per Gaussian, so two Gaussians share a
beat: L as integers of 4 bits times a common power of two, and opacity and offsets in coarser steps.
`spec.small` expands them to the fields of a whole beat, exactly.

Models with levels of detail also have coarser chunks. They are stored among the others, and each
chunk header follows a record of where a view may stop refining (`spec.levels`).
"""

from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from splatcore.spec.colour import (
    BASE,
    CHANNELS,
    DEGREES,
    LAYOUT_BITS,
    LAYOUTS,
    STEP_BITS,
)
from splatcore.spec.config import KB, Config
from splatcore.spec.number import FP16, Bits, Fixed, Float
from splatcore.spec.record import Array, Format, Record

MAGIC = int.from_bytes(b"SPLT", "little")
"""The letters SPLT, which mark a packed model, and the machine in its register ID."""
VERSIONS = 3, 4, 5
"""Versions of models: without, and with, `antialiased` set in their header; with levels."""

ALIGNMENT = 64
"""Every part begins at a multiple of this many bytes, a short burst."""

CODEBOOK_MAX = 8 * KB
"""Maximum bytes of both codebooks together, in DRAM and on chip."""

COMPACT_DEGREE = 1
"""Highest SH degree of models with codebooks."""

CHUNK = 256
"""Gaussians per chunk (the last chunk of a model may have fewer)."""
LEVEL_SIZE = 32
"""Bytes of the record before each chunk header in models with levels, `spec.levels.LEVEL`."""

ORIGIN_BITS = 40  # of a coordinate of a chunk's origin, in grid steps
OFFSET_BITS = 16  # of an offset from a chunk's origin
STORED_BITS = OFFSET_BITS - 1  # of an offset in DRAM: all except its top bit
SMALL_STORED_BITS = 9  # of an offset in small models: the bits after its top bit
OCTANTS = 8  # of a chunk, by the top bits of the three offsets
EXTENT_SHIFT = 8
"""A chunk's extent is its largest offset shifted right by this many bits."""

ABSOLUTE = FP16  # an absolute coordinate (`position` "absolute")
ABSOLUTE_EXPONENT = 1 - ABSOLUTE.bias - ABSOLUTE.fraction  # of the unit of such coordinates

ON_DIAGONAL = ("l00", "l11", "l22")
BELOW = ("l10", "l20", "l21")
"""Elements of L by row and column."""

FACTOR = Float(5, 10)  # element of L below the diagonal: FP16's bits without infinities
DIAGONAL = Float(5, 10, signed=False)  # element on the diagonal

OPACITY = Fixed(3, 5)  # −log2(opacity)

ATTRIBUTE_BITS = 128  # of the first beat of attributes: one machine beat
SMALL_BITS = ATTRIBUTE_BITS // 2  # of the attributes of a small model's Gaussian

MAGNITUDE = Bits(4)  # element of L on the diagonal, in a small model
SIGNED_MAGNITUDE = Bits(MAGNITUDE.width + 1)  # element below the diagonal, the sign on top

SHARED_EXPONENT = Bits(5)  # common power of two of these elements: 2^(code + `spec.small.UNIT`)
SMALL_OPACITY = Fixed(3, 2)  # −log2(opacity) of a small model

COMPONENT = Fixed(11, 0, signed=True)  # of a colour entry, in units of 2^E of degree 0
SLOPE = Fixed(9, 0, signed=True)  # of an SH entry, in units of 2^E of degree 1

REACH = Float(7, 9, signed=False)
"""Upper bound of the distance at which a chunk's Gaussian has alpha ≥ 1/255 (scene units)."""

EXPONENT_MAX = 255
"""Largest magnitude of an exponent in the header."""

POSITION_FORMATS = ("chunk", "absolute")
"""Kinds of positions, by the number in the header."""

HEADER = Record(
    "header",
    {
        "magic": Bits(32),  # `MAGIC`
        "version": Bits(16),  # one of `VERSIONS`
        "sh_degree": Bits(8),  # highest degree of the harmonics
        "position": Bits(7),  # index into `POSITION_FORMATS`
        "small": Bits(1),  # attributes take half a beat per Gaussian
        "count": Bits(32),  # Gaussians
        "checksum": Bits(32),  # CRC-32 of everything except this field
        "position_exponent": Fixed(15, 0, signed=True),  # log2 of the grid's step, scene units
        "factor_exponent": Fixed(15, 0, signed=True),  # log2 of the unit of L, scene units
        "exponent": Array(Fixed(15, 0, signed=True), DEGREES),  # E of each degree (`spec.colour`)
        "colour_index": Array(Bits(8), 4),  # index bits of each stage, else 0
        "sh_index": Array(Bits(8), 4),  # likewise
        "positions": Bits(32),  # offset from the header in units of `ALIGNMENT`
        "attributes": Bits(32),  # likewise
        "colours": Bits(32),  # likewise; the SH codebook follows the colour codebook
        "end": Bits(32),  # likewise
        "antialiased": Bits(1),  # opacities are compensated for the blur (`spec.compensation`)
        "levels": Bits(1),  # there are coarser chunks (`spec.levels`)
        "spare": Bits(30),
        "reserved": Array(Bits(32), 2),
    },
)
"""First record of a packed model."""

PLACED = ("positions", "attributes", "colours", "end")
"""Parts with an offset in the header; chunk headers follow the header directly."""

CHUNK_HEADER = Record(
    "chunk_header",
    {
        "origin": Array(Fixed(ORIGIN_BITS - 1, 0, signed=True), 3),  # grid steps
        "shift": Array(Bits(5), 3),  # of offsets to the left, per axis
        "extent": Array(Bits(OFFSET_BITS - EXTENT_SHIFT), 3),  # largest offset >> EXTENT_SHIFT
        "reach": REACH,  # of the chunk's farthest-reaching Gaussian
        "octant_end": Array(Bits(9), OCTANTS - 1),  # Gaussians in octants 0 … k, for k = 0 … 6
        "harmonics": Bits(LAYOUT_BITS),  # index into `spec.colour.LAYOUTS`
        "step": Array(Bits(STEP_BITS), DEGREES),  # s of each degree (`spec.colour`)
    },
)
"""Header of a chunk."""

COLOUR_ENTRY = Record("colour", {"rgb": Array(COMPONENT, 3), "reserved": Bits(28)})
"""One entry of a colour codebook stage, 64 bits."""

SH_ENTRY = Record("sh", {"g": Array(SLOPE, 9), "reserved": Bits(38)})
"""One entry of an SH codebook stage, 128 bits: G row by row (red·x, red·y, … blue·z)."""

CODEBOOK_WORD = SH_ENTRY.size
"""Bytes per word of the codebook memory, into which both codebooks are copied unchanged. A word is
one SH entry, or several colour entries, the first in the least significant bits."""


@dataclass(frozen=True)
class ModelFormat:
    """Formats of a model's parts: everything except its numbers of Gaussians and beats."""

    sh_degree: int  # highest degree of its harmonics
    position: str  # one of `POSITION_FORMATS`
    colour_index: tuple[int, ...]  # index bits of each codebook stage; empty for models in steps
    sh_index: tuple[int, ...]  # likewise
    small: bool = False  # attributes take half a beat
    levels: bool = False  # a record precedes each chunk header

    @property
    def codebooks(self) -> bool:
        """True if colours are sums of codebook entries, False if they are in steps."""
        return bool(self.colour_index)

    @property
    def stored_bits(self) -> int:
        """Stored bits of an offset."""
        return SMALL_STORED_BITS if self.small else STORED_BITS

    @property
    def position_record(self) -> Record:
        """One Gaussian's stored position; a chunk's positions are stored back to back."""
        format = Bits(self.stored_bits) if self.position == "chunk" else ABSOLUTE
        return Record("position", {axis: format for axis in "xyz"})

    @property
    def attribute_record(self) -> Record:
        """The first beat of a Gaussian's attributes."""
        fields: dict[str, Format] = dict.fromkeys(ON_DIAGONAL, DIAGONAL)
        fields |= dict.fromkeys(BELOW, FACTOR)
        return self._filled(fields | {"opacity": OPACITY}, ATTRIBUTE_BITS)

    @property
    def stored_record(self) -> Record:
        """The record as stored in DRAM: `attribute_record`, or its compact form (`spec.small`)."""
        if not self.small:
            return self.attribute_record
        fields: dict[str, Format] = {"exponent": SHARED_EXPONENT}
        fields |= dict.fromkeys(ON_DIAGONAL, MAGNITUDE) | dict.fromkeys(BELOW, SIGNED_MAGNITUDE)
        return self._filled(fields | {"opacity": SMALL_OPACITY}, SMALL_BITS)

    def _filled(self, fields: dict[str, Format], bits: int) -> Record:
        """Complete a record of `bits` bits with the fields of the colour."""
        for part, stages in (("colour", self.colour_index), ("sh", self.sh_index)):
            fields |= {f"{part}{stage}": Bits(own) for stage, own in enumerate(stages)}
        if not self.codebooks:
            fields |= dict.fromkeys(CHANNELS, BASE)
        spare = bits - sum(format.width for format in fields.values())
        if spare < 0:
            raise ValueError(f"{self}: attributes are {-spare} bits too wide")
        return Record("attribute", fields | ({"reserved": Bits(spare)} if spare else {}))

    @property
    def header_stride(self) -> int:
        """Bytes from one chunk header to the next."""
        return CHUNK_HEADER.size + LEVEL_SIZE * self.levels

    @property
    def position_stride(self) -> int:
        """Bytes from one chunk's positions to the next chunk's."""
        return CHUNK * self.position_record.width // 8

    @property
    def colour_entries(self) -> int:
        """Entries of all colour stages together."""
        return sum(1 << bits for bits in self.colour_index)

    @property
    def sh_entries(self) -> int:
        """Entries of all SH stages together."""
        return sum(1 << bits for bits in self.sh_index)

    @property
    def codebook_bytes(self) -> int:
        """Bytes of both codebooks."""
        return self.colour_entries * COLOUR_ENTRY.size + self.sh_entries * SH_ENTRY.size

    @property
    def codebook_words(self) -> dict[str, int]:
        """First word of each stage in the codebook memory: colour0 …, sh0 …."""
        layout, words = self.layout(0), {}
        for part, start, entry, stages in (
            ("colour", layout.colours, COLOUR_ENTRY, self.colour_index),
            ("sh", layout.sh, SH_ENTRY, self.sh_index),
        ):
            for stage, bits in enumerate(stages):
                words[f"{part}{stage}"] = (start - layout.colours) // CODEBOOK_WORD
                start += entry.size << bits
        return words

    def layout(self, count: int, harmonics: int = 0) -> "Layout":
        """Return the offsets for `count` Gaussians with `harmonics` beats of harmonics in all."""
        chunks, rest = divmod(count, CHUNK)
        sizes = (
            HEADER.size,
            chunk_count(count) * self.header_stride,
            chunks * self.position_stride + -(-rest * self.position_record.width // 8),
            count * self.stored_record.size + harmonics * ATTRIBUTE_BITS // 8,
            self.colour_entries * COLOUR_ENTRY.size,
            self.sh_entries * SH_ENTRY.size,
        )
        return Layout(*accumulate((-(-n // ALIGNMENT) * ALIGNMENT for n in sizes), initial=0))


@dataclass(frozen=True)
class Layout:
    """Byte offsets of a model's parts from its base address, and its end."""

    header: int
    chunks: int
    positions: int
    attributes: int
    colours: int
    sh: int
    end: int


def model_format(config: Config, degree: int, small: bool = False) -> ModelFormat:
    """Return a machine's format of compact or small models of SH degree 0 or 1."""
    indices = config.colour_index[degree], config.sh_index[degree]
    return ModelFormat(degree, config.position, *indices, small)


def compact_degrees(config: Config) -> range:
    """Return the SH degrees of the compact models that a machine renders."""
    return range(min(config.sh_degree, COMPACT_DEGREE) + 1)


def harmonics_bytes(config: Config) -> int:
    """Bytes of all slots' harmonics, held in the codebook memory with models in steps."""
    if config.colours == "array" or not config.sh_degree:
        return 0
    most = max(layout.beats for layout in LAYOUTS)
    return config.projection_slots * most * ATTRIBUTE_BITS // 8


def step_format(config: Config, degree: int) -> ModelFormat:
    """Return a machine's format of models in steps of an SH degree."""
    return ModelFormat(degree, config.position, (), ())


def chunk_count(count: int) -> int:
    """Return the number of chunks of `count` Gaussians."""
    return -(-count // CHUNK)


def chunk_sizes(count: int) -> np.ndarray:
    """Return the Gaussians [C] of each chunk of `count` Gaussians; the last one may be short."""
    return np.minimum(count - np.arange(chunk_count(count)) * CHUNK, CHUNK)
