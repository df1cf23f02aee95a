"""The packed model as it lies in DRAM: records, their order, their addresses.

    header │ chunk headers │ positions │ attributes │ colour codebook │ SH codebook

Every part begins at a multiple of `ALIGNMENT`. Gaussians are stored in chunks of `CHUNK` along the
Morton curve. A coordinate is an integer on the model's grid: the chunk's origin plus an offset of
`OFFSET_BITS` shifted left by the chunk's shift for that axis, times 2^position_exponent:

    coordinate = (origin + (offset << shift)) · 2^position_exponent

so adding is exact and multiplying by the step is a change of exponent. Within a chunk Gaussians
are ordered by octant (the top bits of the three offsets, x lowest), so those bits follow from a
Gaussian's place and the header's octant ends; only the rest is stored, 45 bits a Gaussian (27 in
small models, where offsets end in zeros). With absolute positions (`PAPER`) a coordinate is stored
as a float, the grid's step is the smallest one, and headers tell only the reach.

The first beat of a Gaussian's attributes holds L, the lower-triangular factor of the 3D covariance
L·Lᵀ, times 2^−factor_exponent (its diagonal is never negative and has no sign bit), −log2(opacity),
and its colour, in one of two ways (`spec.colour` has the arithmetic):

- Codebooks (compact models, degree 0 or 1): one index for each stage. The sum of one entry per
  stage, times 2^E of degree 0, is the colour that the original renderer has as SH0·C0 + 0.5; the
  SH entries sum to the 3×3 matrix G (times 2^E of degree 1) in colour + G·direction, with the unit
  direction from camera to Gaussian: the degree-1 harmonics with their constants multiplied in.
- Steps (all index bits 0): the base in 9 bits a channel; harmonics lie in further beats right
  behind the first, as many as the chunk's header says (`spec.colour.LAYOUTS`), which has the steps.

Attributes of a chunk follow those of the chunk before.

Small models have codebooks and half a beat of attributes for each Gaussian, so two share a beat:
L as integers of 4 bits times a power of two that its elements share, and opacity and offsets in
coarser steps. `spec.small` makes the fields of a whole beat of them, exactly.
"""

from dataclasses import dataclass
from itertools import accumulate

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
VERSIONS = 3, 4
"""Versions of models without and with the mark `antialiased` in their header: machines that do not
compensate opacities take the first only."""

ALIGNMENT = 64
"""Bytes: parts begin at a multiple of a short burst."""

CODEBOOK_MAX = 8 * KB
"""Bytes of both codebooks together, in DRAM as on chip."""

COMPACT_DEGREE = 1
"""The highest degree for which there are codebooks."""

CHUNK = 256
"""Gaussians in a chunk (the last one of a model may have fewer)."""

ORIGIN_BITS = 40
OFFSET_BITS = 16
STORED_BITS = OFFSET_BITS - 1
SMALL_STORED_BITS = 9
"""Of an offset, without its top bit: all, and what small models have of them, the top ones."""
OCTANTS = 8
EXTENT_SHIFT = 8
"""A chunk's extent is its largest offset shifted right by this."""

ABSOLUTE = FP16
"""Coordinates that are stored as such (`position` "absolute")."""

ABSOLUTE_EXPONENT = 1 - ABSOLUTE.bias - ABSOLUTE.fraction
"""All of them are multiples of 2^this."""

ON_DIAGONAL = ("l00", "l11", "l22")
BELOW = ("l10", "l20", "l21")
"""Elements of L by row and column."""

FACTOR = Float(5, 10)
DIAGONAL = Float(5, 10, signed=False)
"""Elements of L below and on its diagonal: FP16's bits without infinities."""

OPACITY = Fixed(3, 5)
"""−log2(opacity)."""

ATTRIBUTE_BITS = 128
"""One AXI beat."""

SMALL_BITS = ATTRIBUTE_BITS // 2
"""Attributes of a Gaussian of a small model."""

MAGNITUDE = Bits(4)
SIGNED_MAGNITUDE = Bits(MAGNITUDE.width + 1)
"""Elements of L of a small model on its diagonal, and below it with the sign on top."""

SHARED_EXPONENT = Bits(5)
"""What these are multiplied with: 2^(code + `spec.small.UNIT`)."""

SMALL_OPACITY = Fixed(3, 2)
"""−log2(opacity) of a small model."""

COMPONENT = Fixed(11, 0, signed=True)
SLOPE = Fixed(9, 0, signed=True)
"""Components of a colour entry and of an SH entry, in units of 2^exponent of the header."""

REACH = Float(7, 9, signed=False)
"""Bound on how far from its centre a Gaussian of the chunk has alpha ≥ 1/255 (scene units)."""

EXPONENT_MAX = 255
"""Exponents of the header are at most this, up and down."""

POSITION_FORMATS = ("chunk", "absolute")
"""Values of the header's `position` field, by their index."""

HEADER = Record(
    "header",
    {
        "magic": Bits(32),
        "version": Bits(16),
        "sh_degree": Bits(8),
        "position": Bits(7),
        "small": Bits(1),  # attributes take half a beat each
        "count": Bits(32),
        "checksum": Bits(32),  # CRC-32 of everything but this field
        "position_exponent": Fixed(15, 0, signed=True),
        "factor_exponent": Fixed(15, 0, signed=True),
        "exponent": Array(Fixed(15, 0, signed=True), DEGREES),  # E of each degree (`spec.colour`)
        "colour_index": Array(Bits(8), 4),  # index bits of each stage, 0 where there is none
        "sh_index": Array(Bits(8), 4),
        "positions": Bits(32),  # where these parts begin, in units of ALIGNMENT from the header on
        "attributes": Bits(32),
        "colours": Bits(32),
        "end": Bits(32),
        "antialiased": Bits(1),  # opacities are compensated for the blur (`spec.compensation`)
        "spare": Bits(31),
        "reserved": Array(Bits(32), 2),
    },
)

PLACED = ("positions", "attributes", "colours", "end")
"""Parts of a model whose place its header tells; chunk headers follow the header."""

CHUNK_HEADER = Record(
    "chunk_header",
    {
        "origin": Array(Fixed(ORIGIN_BITS - 1, 0, signed=True), 3),
        "shift": Array(Bits(5), 3),
        "extent": Array(Bits(OFFSET_BITS - EXTENT_SHIFT), 3),
        "reach": REACH,
        "octant_end": Array(Bits(9), OCTANTS - 1),  # Gaussians of the chunk up to that octant
        "harmonics": Bits(LAYOUT_BITS),  # one of `spec.colour.LAYOUTS`
        "step": Array(Bits(STEP_BITS), DEGREES),
    },
)


COLOUR_ENTRY = Record("colour", {"rgb": Array(COMPONENT, 3), "reserved": Bits(28)})
"""One entry of a colour codebook stage, 64 bits."""

SH_ENTRY = Record("sh", {"g": Array(SLOPE, 9), "reserved": Bits(38)})
"""One entry of an SH codebook stage, 128 bits: G row by row (red·x, red·y, … blue·z)."""

CODEBOOK_WORD = SH_ENTRY.size
"""Bytes of a word of the codebook memory: an SH entry, or as many colour entries as fit, the first
in the least significant bits. Both codebooks are copied there as they lie in DRAM."""


@dataclass(frozen=True)
class ModelFormat:
    """Formats of a model's parts: everything but the number of Gaussians and of their beats.

    `colour_index` and `sh_index` hold the index bits of each codebook stage; there are none in
    models in steps. `small`: attributes take half a beat.
    """

    sh_degree: int
    position: str
    colour_index: tuple[int, ...]
    sh_index: tuple[int, ...]
    small: bool = False

    @property
    def codebooks(self) -> bool:
        """True if colours are sums of codebook entries, False if they are in steps."""
        return bool(self.colour_index)

    @property
    def stored_bits(self) -> int:
        """Bits of an offset that are stored."""
        return SMALL_STORED_BITS if self.small else STORED_BITS

    @property
    def position_record(self) -> Record:
        """One Gaussian's stored position; those of a chunk lie back to back."""
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
        """What of it lies in memory: all, or in small models what `spec.small` makes it of."""
        if not self.small:
            return self.attribute_record
        fields: dict[str, Format] = {"exponent": SHARED_EXPONENT}
        fields |= dict.fromkeys(ON_DIAGONAL, MAGNITUDE) | dict.fromkeys(BELOW, SIGNED_MAGNITUDE)
        return self._filled(fields | {"opacity": SMALL_OPACITY}, SMALL_BITS)

    def _filled(self, fields: dict[str, Format], bits: int) -> Record:
        """A record of so many bits of these fields and those of the colour."""
        for part, stages in (("colour", self.colour_index), ("sh", self.sh_index)):
            fields |= {f"{part}{stage}": Bits(own) for stage, own in enumerate(stages)}
        if not self.codebooks:
            fields |= dict.fromkeys(CHANNELS, BASE)
        spare = bits - sum(format.width for format in fields.values())
        if spare < 0:
            raise ValueError(f"{self}: attributes are {-spare} bits too wide")
        return Record("attribute", fields | ({"reserved": Bits(spare)} if spare else {}))

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
        """Byte offsets of the parts of a model of `count` Gaussians with so many beats of harmonics
        in all."""
        chunks, rest = divmod(count, CHUNK)
        sizes = (
            HEADER.size,
            chunk_count(count) * CHUNK_HEADER.size,
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
    """The format in which a machine wants its compact or small models of that SH degree, 0 or 1."""
    indices = config.colour_index[degree], config.sh_index[degree]
    return ModelFormat(degree, config.position, *indices, small)


def compact_degrees(config: Config) -> range:
    """Degrees of the compact models that a machine renders."""
    return range(min(config.sh_degree, COMPACT_DEGREE) + 1)


def harmonics_bytes(config: Config) -> int:
    """Bytes of the beats of harmonics of all slots of the projection: the codebook memory holds
    them while a model in steps is rendered."""
    if config.colours == "array" or not config.sh_degree:
        return 0
    most = max(layout.beats for layout in LAYOUTS)
    return config.projection_slots * most * ATTRIBUTE_BITS // 8


def step_format(config: Config, degree: int) -> ModelFormat:
    """The format in which a machine wants models in steps of that SH degree."""
    return ModelFormat(degree, config.position, (), ())


def chunk_count(count: int) -> int:
    """Chunks that `count` Gaussians fill."""
    return -(-count // CHUNK)
