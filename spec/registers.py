"""The register map: what the host writes and reads over AXI4-Lite, in words of 32 bits.

Hardware, documentation, the C header and the testbench's names are all made from `register_map`.

A frame: write the frame's registers, then START to CONTROL while STATUS says READY. Its points are
made from these registers, which are locked meanwhile; with READY again (and an interrupt) the next
frame's may be written and started, while this one's tiles are rendered. FRAME tells that all its
pixels are in memory. Numbers of `Config.arithmetic` are codes, as `spec.frame` rounds them.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from splatcore.spec.axi import ADDRESS_BITS, LITE_DATA_BITS, window_bits
from splatcore.spec.binning import PAGE_BITS, groups_max
from splatcore.spec.colour import colour_format
from splatcore.spec.compensation import MODEL_CONSTANTS
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.counters import COUNTER_BITS, counters
from splatcore.spec.frame import CAMERA, FrameConstants, fixed_constants
from splatcore.spec.group import SPLAT_BITS
from splatcore.spec.memory import ALIGNMENT, MAGIC, VERSIONS
from splatcore.spec.programs import BASIS_CONSTANTS, CONSTANTS
from splatcore.spec.raster import COLOURS
from splatcore.spec.work import STRIDE_ALIGNMENT, STRIDE_BITS, WORK_ALIGNMENT

WORD = LITE_DATA_BITS // 8
"""Bytes from one register to the next."""

Access = Literal["read", "write", "frame", "clear", "control"]
"""read: cannot be written. write: read and written. frame: the same, but locked while points are
made. clear: bits written as 1 are cleared. control: writing commands, reads as 0."""

START, ABORT = 1 << 0, 1 << 1
"""CONTROL: begin a frame; give up all frames that have begun."""

READY, PREPROCESSING, RENDERING = 1 << 0, 1 << 1, 1 << 2
"""STATUS: START is taken; points are being made; tiles are being rendered."""

INTERRUPT_READY, INTERRUPT_FRAME, INTERRUPT_ERROR = 1 << 0, 1 << 1, 1 << 2
"""INTERRUPT: READY has come; a frame is complete; ERROR says what went wrong."""


class ErrorCode(IntEnum):
    """An error, in the lowest 8 bits of ERROR; the first error stays until it is cleared."""

    NONE = 0
    START = 1  # START while not READY: nothing was begun
    LOCKED = 2  # a frame's register, the detail, was written while points were made: not changed
    SIZE = 3  # width (detail 0; of all groups, too), height (1) or stride (2) cannot be
    MAGIC = 4  # there is no packed model at MODEL
    VERSION = 5  # the model's version is another one
    FORMAT = 6  # the model's positions, colours or exponents do not fit this machine
    FEATURES = 7  # more than FEATURES_MAX splats touch the image
    PAGES = 8  # LISTS_PAGES pages do not hold the lists; NEEDED says how many would
    READ = 10  # AXI read error; the detail is the reader
    WRITE = 11  # AXI write error; the detail is the writer
    ALIGNMENT = 12  # an address is no multiple of what it has to be; the detail is its register
    DEGREE = 13  # the model's SH degree, the detail, is above SH_DEGREE_MAX
    STRAY = 14  # an AXI answer that nobody waits for, dropped: the bus is at fault; frames go on
    RANGE = 15  # what begins at an address, the detail is its register, ends beyond 4 GiB
    PARTS = 16  # the model's parts are out of order, or do not hold as many Gaussians as it says


FRAME_BITS = 16
"""Width of the counts of frames."""

CODE_BITS = 8
DETAIL_BITS = 8
"""ERROR: the code, above it the detail (`ErrorCode`; else 0). Registers as details are counted from
the first one of a frame on."""

HALVES_AT, HALVES_BITS = CODE_BITS + DETAIL_BITS, 2
"""ERROR, above the detail: a bit for each half (`spec.axi`) that has given up its frame by an
error, this one or a later one, since ERROR was last written. ABORT sets none."""


def split_error(value: int) -> tuple[ErrorCode, int, int]:
    """Code, detail and halves of a value of ERROR."""
    above, code = divmod(value, 1 << CODE_BITS)
    halves, detail = divmod(above, 1 << DETAIL_BITS)
    return ErrorCode(code), detail, halves


ALIGNED = {
    "MODEL": ALIGNMENT,
    **dict.fromkeys(("GROUPS", "LISTS", "FEATURES", "WORK_AREA", "SCRATCH"), WORK_ALIGNMENT),
    "PIXELS": STRIDE_ALIGNMENT,
}
"""Registers of a frame whose value must be a multiple of so many bytes."""

WIDE = 1 << 16
"""VERSION: addresses have 64 bits, so that there are the registers of `high_registers`."""


@dataclass(frozen=True)
class Register:
    """A word. value: what it reads as, if that never changes."""

    name: str
    width: int
    access: Access
    about: str
    value: int | None = None

    @property
    def reset(self) -> int | None:
        """What it reads as after a reset; None: what the machine has to tell then."""
        return self.value if self.access == "read" else 0


def variable_constants(config: Config) -> list[str]:
    """Constants of `spec.programs` that depend on the camera."""
    others = {*fixed_constants(config), *BASIS_CONSTANTS, *MODEL_CONSTANTS}
    return [name for name in CONSTANTS if name not in others]


def control_registers(config: Config) -> list[Register]:
    """Registers of every machine."""
    size, most = config.width_max | config.height_max << 16, groups_max(config)
    side = TILE * config.group
    about_groups = f"most groups of {side} x {side} pixels of an image, of any width and height"
    version, about = VERSIONS[config.compensates], "newest version of packed models that it takes"
    if window_bits(config):
        version, about = version | WIDE, f"{about}; addresses have 64 bits << 16"
    return [
        Register("ID", 32, "read", "says 'SPLT'", MAGIC),
        Register("VERSION", max(16, version.bit_length()), "read", about, version),
        Register(
            "PICTURE_MAX", 32, "read", "width, and height << 16, of the preset's own image", size
        ),
        Register("CONTROL", 2, "control", "START, ABORT"),
        Register("STATUS", 3, "read", "READY, PREPROCESSING, RENDERING"),
        Register("INTERRUPT", 3, "clear", "READY, FRAME, ERROR"),
        Register("INTERRUPT_ENABLE", 3, "write", "which of them raise the interrupt"),
        Register(
            "ERROR",
            HALVES_AT + HALVES_BITS,
            "clear",
            f"code, detail << {CODE_BITS}, halves << {HALVES_AT}; any write clears",
        ),
        Register("STARTED", FRAME_BITS, "read", "frames that have begun, modulo 2^16"),
        Register("FINISHED", FRAME_BITS, "read", "frames that are complete, modulo 2^16"),
        Register("NEEDED", PAGE_BITS, "read", "list pages that the last frame's points took"),
        Register("GROUPS_MAX", most.bit_length(), "read", about_groups, most),
    ]


def frame_registers(config: Config) -> list[Register]:
    """Registers of a frame."""

    def address(name: str, about: str) -> Register:
        about = f"{about}, a multiple of {ALIGNED[name]}"
        return Register(name, ADDRESS_BITS, "frame", about)

    colour = colour_format(config).width
    registers = [
        Register("WIDTH", config.side_max.bit_length(), "frame", "of the image, pixels"),
        Register("HEIGHT", config.side_max.bit_length(), "frame", "of the image, pixels"),
        address("MODEL", "address of the packed model"),
        address("GROUPS", "address of work area 0's table of groups"),
        address("LISTS", "address of work area 0's list pages"),
        address("FEATURES", "address of work area 0's features"),
        address("WORK_AREA", "bytes from work area 0 to work area 1"),
        Register("LISTS_PAGES", PAGE_BITS, "frame", "list pages of a work area"),
        Register("FEATURES_MAX", SPLAT_BITS, "frame", "features of a work area"),
        address("SCRATCH", "address of scratch memory"),
        address("PIXELS", "address of the image"),
        Register(
            "STRIDE",
            STRIDE_BITS,
            "frame",
            f"bytes from a row to the next, a multiple of {STRIDE_ALIGNMENT}",
        ),
    ]
    registers += [
        Register(f"BACKGROUND_{name.upper()}", colour, "frame", f"{name}, units of 2^-9·255/256")
        for name in COLOURS
    ]
    registers += [
        Register(f"CAMERA_{axis}_{part}", width, "frame", f"camera's {axis}, grid steps, {bits}")
        for axis in "XYZ"
        for part, width, bits in (
            ("LOW", LITE_DATA_BITS, "lower 32 bits"),
            ("HIGH", CAMERA.width - LITE_DATA_BITS, "upper bits"),
        )
    ]
    number = config.arithmetic.width
    registers.append(Register("NEAR_PLANE", number, "frame", "depth below which all is dropped"))
    for name in variable_constants(config):
        about = f"constant {name} of the projection"
        registers.append(Register(f"CONSTANT_{name.upper()}", number, "frame", about))
    return registers + high_registers(config)


def high_registers(config: Config) -> list[Register]:
    """Registers of a frame for the upper bits of its addresses, the last ones of a frame; none
    where addresses have 32 bits."""
    bits = window_bits(config)
    names = [name for name in ALIGNED if name != "WORK_AREA"] if bits else []
    about = "upper bits of {}, and of all that it is the begin of"
    return [Register(f"{name}_HIGH", bits, "frame", about.format(name)) for name in names]


def address_values(config: Config, name: str, address: int) -> dict[str, int]:
    """Values of an address's registers."""
    high, low = divmod(address, 1 << ADDRESS_BITS)
    return {name: low} | ({f"{name}_HIGH": high} if window_bits(config) else {})


def counter_registers(config: Config) -> list[Register]:
    """Performance counters."""
    return [
        Register(f"{stage.upper()}_{name.upper()}", COUNTER_BITS, "read", f"{stage}: {about}")
        for stage, names in counters(config).items()
        for name, about in names.items()
    ]


FRAME_START, COUNTER_START = 0x100, 0x400
"""Addresses of the first frame register and of the first counter."""


def register_map(config: Config) -> dict[int, Register]:
    """All registers by their address."""
    found: dict[int, Register] = {}
    for start, registers in (
        (0, control_registers(config)),
        (FRAME_START, frame_registers(config)),
        (COUNTER_START, counter_registers(config)),
    ):
        for k, register in enumerate(registers):
            if start + k * WORD in found:
                raise ValueError(f"{config.name}: register {register.name} has no place")
            found[start + k * WORD] = register
    return found


def addresses(config: Config) -> dict[str, int]:
    """The address of each register by its name."""
    return {register.name: address for address, register in register_map(config).items()}


def camera_values(config: Config, frame: FrameConstants) -> dict[str, int]:
    """Values of a camera's registers."""
    mask = (1 << LITE_DATA_BITS) - 1
    found = {"NEAR_PLANE": int(config.arithmetic.encode(frame.near_plane))}
    for axis, value in zip("XYZ", frame.camera, strict=True):
        code = int(value) % (1 << CAMERA.width)
        found |= {f"CAMERA_{axis}_LOW": code & mask}
        found |= {f"CAMERA_{axis}_HIGH": code >> LITE_DATA_BITS}
    for name in variable_constants(config):
        code = config.arithmetic.encode(frame.constants[name])
        found[f"CONSTANT_{name.upper()}"] = int(code)
    return found
