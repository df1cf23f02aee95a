"""The register map: what the host writes and reads over AXI4-Lite, in words of 32 bits.

Hardware, documentation, the C header, SystemRDL and the testbench's names all come from
`register_map`.

To render a frame, write the frame's registers, then START to CONTROL while STATUS has READY. The
machine preprocesses the frame's points from these registers and locks them meanwhile. READY (with
an interrupt) reports that the next frame may be written and started while this frame's tiles are
rendered. INTERRUPT's FRAME reports that all pixels of a frame are in memory. Numbers of
`Config.arithmetic` are codes, rounded as in `spec.frame`.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple

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
from splatcore.spec.programs import BASIS_CONSTANTS, CONSTANTS, LEVEL_CONSTANTS
from splatcore.spec.raster import COLOURS
from splatcore.spec.work import STRIDE_ALIGNMENT, STRIDE_BITS, WORK_ALIGNMENT

WORD = LITE_DATA_BITS // 8
"""Bytes from one register to the next."""

Access = Literal["read", "write", "frame", "clear", "control"]
"""Access by the host.

read: read only
write: read and written
frame: read and written, but locked while points are preprocessed
clear: bits written as 1 are cleared
control: written as commands, reads as 0
"""

START, ABORT = 1 << 0, 1 << 1
"""Bits of CONTROL: begin a frame; abort all frames that have begun."""

READY, PREPROCESSING, RENDERING = 1 << 0, 1 << 1, 1 << 2
"""Bits of STATUS: START is accepted; points are preprocessed; tiles are rendered."""

INTERRUPT_READY, INTERRUPT_FRAME, INTERRUPT_ERROR = 1 << 0, 1 << 1, 1 << 2
"""Bits of INTERRUPT: READY has risen; a frame is complete; ERROR holds an error."""


class ErrorCode(IntEnum):
    """An error, in the lowest 8 bits of ERROR; the first error stays until it is cleared."""

    NONE = 0
    START = 1  # START while not READY: no frame has begun
    LOCKED = 2  # a frame's register (the detail) was written while locked: it keeps its value
    SIZE = 3  # invalid width or too many groups (detail 0), height (1) or stride (2)
    MAGIC = 4  # the address in MODEL holds no packed model
    VERSION = 5  # the machine does not read models of this version
    FORMAT = 6  # the model's positions, colours or exponents do not fit this machine
    FEATURES = 7  # more than FEATURES_MAX splats touch the image
    PAGES = 8  # the lists need more than LISTS_PAGES pages; NEEDED has their number
    READ = 10  # AXI read error; the detail is the reader
    WRITE = 11  # AXI write error; the detail is the writer
    ALIGNMENT = 12  # a misaligned address; the detail is its register
    DEGREE = 13  # the model's SH degree (the detail) is above SH_DEGREE_MAX
    STRAY = 14  # an unexpected AXI response, dropped: a fault of the bus; frames go on
    RANGE = 15  # the area at an address ends beyond 4 GiB; the detail is the address's register
    PARTS = 16  # the model's parts are out of order or too short for its number of Gaussians
    LEVELS = 17  # a record of the model's levels of detail contradicts its place


FRAME_BITS = 16
"""Width of the counts of frames."""

CODE_BITS = 8
"""Bits of ERROR's code, its lowest field."""
DETAIL_BITS = 8
"""Bits of ERROR's detail, above the code (`ErrorCode`; else 0).

A register as a detail is counted from the first register of a frame.
"""

HALVES_AT, HALVES_BITS = CODE_BITS + DETAIL_BITS, 2
"""ERROR, above the detail: one bit per half (`spec.axi`), set if an error aborted the half's frame
since ERROR was last written: the reported error or a later one. ABORT sets none.
"""


class Error(NamedTuple):
    """The fields of ERROR."""

    code: ErrorCode
    detail: int
    halves: int


def split_error(value: int) -> Error:
    """Return the fields of a value of ERROR."""
    above, code = divmod(value, 1 << CODE_BITS)
    halves, detail = divmod(above, 1 << DETAIL_BITS)
    return Error(ErrorCode(code), detail, halves)


ALIGNED = {
    "MODEL": ALIGNMENT,
    **dict.fromkeys(("GROUPS", "LISTS", "FEATURES", "WORK_AREA", "SCRATCH"), WORK_ALIGNMENT),
    "PIXELS": STRIDE_ALIGNMENT,
}
"""Registers of a frame that must be multiples of a number of bytes: name → bytes."""

WIDE, ALPHA = 1 << 16, 1 << 17
"""Bits of VERSION: addresses have 64 bits, so the registers of `high_registers` exist; the register
FORMAT exists."""

RGBA = 1 << 0
"""Bit of FORMAT: pixels have alpha (`spec.work`)."""


@dataclass(frozen=True)
class Register:
    """One register."""

    name: str
    width: int
    access: Access
    about: str  # its meaning, for the documentation and the C and SystemRDL files
    value: int | None = None  # the value that it always reads as, if constant

    @property
    def reset(self) -> int | None:
        """Value after a reset; None if it depends on the machine's state."""
        return self.value if self.access == "read" else 0


def variable_constants(config: Config) -> list[str]:
    """Return the constants of `spec.programs` that depend on the camera."""
    others = {*fixed_constants(config), *BASIS_CONSTANTS, *MODEL_CONSTANTS}
    others |= set() if config.levels else {*LEVEL_CONSTANTS}
    return [name for name in CONSTANTS if name not in others]


def control_registers(config: Config) -> list[Register]:
    """Return the registers of every machine."""
    size, most = config.width_max | config.height_max << 16, groups_max(config)
    side = TILE * config.group
    about_groups = f"maximum number of groups of {side} x {side} pixels per image"
    about_error = f"code, detail << {CODE_BITS}, halves << {HALVES_AT}; any write clears it"
    newest = VERSIONS[-1 if config.levels else config.compensates]
    version, about = newest, "newest model version that the machine reads"
    if window_bits(config):
        version, about = version | WIDE, f"{about}; addresses have 64 bits << 16"
    if config.rgba:
        version, about = version | ALPHA, f"{about}; FORMAT exists << 17"
    return [
        Register("ID", 32, "read", "the letters SPLT", MAGIC),
        Register("VERSION", max(16, version.bit_length()), "read", about, version),
        Register("PICTURE_MAX", 32, "read", "width, and height << 16, of the preset's image", size),
        Register("CONTROL", 2, "control", "commands: START, ABORT"),
        Register("STATUS", 3, "read", "state: READY, PREPROCESSING, RENDERING"),
        Register("INTERRUPT", 3, "clear", "pending interrupts: READY, FRAME, ERROR"),
        Register("INTERRUPT_ENABLE", 3, "write", "bits of INTERRUPT that raise the interrupt"),
        Register("ERROR", HALVES_AT + HALVES_BITS, "clear", about_error),
        Register("STARTED", FRAME_BITS, "read", "frames that have begun, modulo 2^16"),
        Register("FINISHED", FRAME_BITS, "read", "frames that are complete, modulo 2^16"),
        Register("NEEDED", PAGE_BITS, "read", "list pages that the last frame needed"),
        Register("GROUPS_MAX", most.bit_length(), "read", about_groups, most),
    ]


def frame_registers(config: Config) -> list[Register]:
    """Return the registers of a frame."""
    side, colour, number = config.side_max.bit_length(), colour_format(config), config.arithmetic
    rows = f"bytes from one row to the next, a multiple of {STRIDE_ALIGNMENT}"
    found = {
        "WIDTH": (side, "image width, pixels"),
        "HEIGHT": (side, "image height, pixels"),
        "MODEL": (ADDRESS_BITS, "address of the packed model"),
        "GROUPS": (ADDRESS_BITS, "address of work area 0's table of groups"),
        "LISTS": (ADDRESS_BITS, "address of work area 0's list pages"),
        "FEATURES": (ADDRESS_BITS, "address of work area 0's features"),
        "WORK_AREA": (ADDRESS_BITS, "bytes from work area 0 to work area 1"),
        "LISTS_PAGES": (PAGE_BITS, "list pages per work area"),
        "FEATURES_MAX": (SPLAT_BITS, "features per work area"),
        "SCRATCH": (ADDRESS_BITS, "address of scratch memory"),
        "PIXELS": (ADDRESS_BITS, "address of the image"),
        "STRIDE": (STRIDE_BITS, rows),
    }
    if config.rgba:
        found["FORMAT"] = 1, "format of pixels: RGBA, or RGB"
    for name in COLOURS:
        about = f"background {name}, units of 2^-{colour.fraction}·255/256"
        found[f"BACKGROUND_{name.upper()}"] = colour.width, about
    for axis in "XYZ":
        about, high = f"camera's {axis}, grid steps,", CAMERA.width - LITE_DATA_BITS
        found[f"CAMERA_{axis}_LOW"] = LITE_DATA_BITS, f"{about} lower 32 bits"
        found[f"CAMERA_{axis}_HIGH"] = high, f"{about} upper bits"
    found["NEAR_PLANE"] = number.width, "points up to this depth are dropped"
    for name in variable_constants(config):
        found[f"CONSTANT_{name.upper()}"] = number.width, f"constant {name} of the projection"
    for name, size in ALIGNED.items():
        width, about = found[name]
        found[name] = width, f"{about}, a multiple of {size}"
    registers = [Register(name, width, "frame", about) for name, (width, about) in found.items()]
    return registers + high_registers(config)


def high_registers(config: Config) -> list[Register]:
    """Return the registers for the upper bits of a frame's addresses, the last ones of a frame.

    Empty if addresses have 32 bits.
    """
    bits = window_bits(config)
    names = [name for name in ALIGNED if name != "WORK_AREA"] if bits else []
    about = "upper bits of {} and of every address in its area"
    return [Register(f"{name}_HIGH", bits, "frame", about.format(name)) for name in names]


def address_values(config: Config, name: str, address: int) -> dict[str, int]:
    """Return the values of an address's registers by name."""
    high, low = divmod(address, 1 << ADDRESS_BITS)
    return {name: low} | ({f"{name}_HIGH": high} if window_bits(config) else {})


def counter_registers(config: Config) -> list[Register]:
    """Return the registers of the performance counters."""
    return [
        Register(f"{stage.upper()}_{name.upper()}", COUNTER_BITS, "read", f"{stage}: {about}")
        for stage, names in counters(config).items()
        for name, about in names.items()
    ]


FRAME_START, COUNTER_START = 0x100, 0x400
"""Addresses of the first register of a frame and of the first counter."""


def register_map(config: Config) -> dict[int, Register]:
    """Return all registers by address."""
    found: dict[int, Register] = {}
    for start, registers in (
        (0, control_registers(config)),
        (FRAME_START, frame_registers(config)),
        (COUNTER_START, counter_registers(config)),
    ):
        for k, register in enumerate(registers):
            if start + k * WORD in found:
                raise ValueError(f"{config.name}: register {register.name} overlaps another")
            found[start + k * WORD] = register
    return found


def addresses(config: Config) -> dict[str, int]:
    """Return the address of each register by name."""
    return {register.name: address for address, register in register_map(config).items()}


def camera_values(config: Config, frame: FrameConstants) -> dict[str, int]:
    """Return the values of a camera's registers by name."""
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
