"""Files of the register map: a Markdown page, a C header and driver, SystemRDL."""

import re
from dataclasses import dataclass
from inspect import getsource
from math import frexp
from pathlib import Path

from splatcore.eda.gates.macros import PREFIX
from splatcore.eda.template import filled, write_texts
from splatcore.spec import registers
from splatcore.spec.axi import ID_BITS, READERS, WRITERS
from splatcore.spec.config import Config
from splatcore.spec.convention import FRUSTUM_MARGIN, NEAR_PLANE, PRINCIPAL_POINT_SHIFT, TILE
from splatcore.spec.frame import EXTENT_MARGIN, GUARD_ROUNDINGS, SURROUND_MARGIN
from splatcore.spec.memory import ALIGNMENT, HEADER
from splatcore.spec.number import Float
from splatcore.spec.registers import ErrorCode, Register, frame_registers, high_registers
from splatcore.spec.work import (
    FEATURE,
    PIXEL,
    PIXEL_RGBA,
    SLOT,
    STRIDE_ALIGNMENT,
    WORK_ALIGNMENT,
    page_bytes,
    scratch_bytes,
)

FILES = ("registers.md", "splatcore.h", "splatcore.rdl", "splatcore_camera.h")
"""Files that depend on the machine; each has a template."""

DRIVER = ("splatcore_driver.h", "splatcore_driver.c", "splatcore_camera.c")
"""Files of the example driver that do not depend on the machine."""

BITS = {
    "CONTROL": {
        "START": (registers.START, "begin a frame"),
        "ABORT": (registers.ABORT, "abort all frames that have begun"),
    },
    "STATUS": {
        "READY": (registers.READY, "START is accepted and a frame's registers may be written"),
        "PREPROCESSING": (registers.PREPROCESSING, "a frame's points are being processed"),
        "RENDERING": (registers.RENDERING, "a frame's tiles are being rendered"),
    },
    "INTERRUPT": {
        "READY": (registers.INTERRUPT_READY, "READY in STATUS has risen"),
        "FRAME": (
            registers.INTERRUPT_FRAME,
            "all pixels of a frame are in memory; FINISHED counts them",
        ),
        "ERROR": (registers.INTERRUPT_ERROR, "an error; ERROR has its code"),
    },
    "FORMAT": {
        "RGBA": (
            registers.RGBA,
            "pixels have a fourth byte, alpha; red, green and blue are premultiplied by it, and "
            "have no background",
        ),
    },
}
"""Bits of registers: mask and meaning by name. INTERRUPT_ENABLE has those of INTERRUPT."""

HALVES = ("PREPROCESSING", "RENDERING")
"""Names of ERROR's bits for the halves that have aborted a frame, the lowest first."""

REGISTER = f"number of the register: (address − {registers.FRAME_START:#x}) / {registers.WORD}"

DETAILS = {
    ErrorCode.LOCKED: REGISTER,
    ErrorCode.ALIGNMENT: REGISTER,
    ErrorCode.RANGE: REGISTER,
    ErrorCode.SIZE: "0 WIDTH, 1 HEIGHT, 2 STRIDE",
    ErrorCode.READ: ", ".join(f"{k} {name}" for k, name in enumerate(READERS)),
    ErrorCode.WRITE: ", ".join(f"{k} {name}" for k, name in enumerate(WRITERS)),
    ErrorCode.DEGREE: "the model's degree",
    ErrorCode.STRAY: f"its ID; plus {1 << ID_BITS} if it answers a write",
}
"""Meaning of the detail, for errors that have one."""


@dataclass(frozen=True)
class Field:
    """A field of a register. low: its lowest bit; encode: enumeration of its values."""

    name: str
    low: int
    width: int
    about: str
    encode: str = ""


def fields(register: Register) -> list[Field]:
    """Fields of a register; a register with one value has the field VALUE."""
    if register.name == "ERROR":
        about = "this half has aborted its frame because of an error"
        return [
            Field("CODE", 0, registers.CODE_BITS, "the first error", "splatcore_error"),
            Field(
                "DETAIL", registers.CODE_BITS, registers.DETAIL_BITS, "detail of the first error"
            ),
            *(Field(name, registers.HALVES_AT + k, 1, about) for k, name in enumerate(HALVES)),
        ]
    bits = BITS.get(register.name.removesuffix("_ENABLE"))
    if bits is None:
        return [Field("VALUE", 0, register.width, register.about)]
    return [Field(name, mask.bit_length() - 1, 1, about) for name, (mask, about) in bits.items()]


def write_register_files(config: Config, folder: Path, prefix: str = PREFIX) -> list[Path]:
    """Write the page, the SystemRDL, the header and the driver into a folder.

    prefix: of file names, and in lower or upper case of names in C and SystemRDL
    Returns the paths of the files.
    """
    # the comments in `ErrorCode`
    meanings = dict(re.findall(r"^    (\w+) = \d+  # (.*)$", getsource(ErrorCode), re.M))
    whole = {name: bit // 8 for name, bit in HEADER.offsets.items() if bit % 8 == 0}
    places = {name: place for name, place in whole.items() if name != "reserved"}
    names = registers.addresses(config)
    facts = {
        "config": config,
        "registers": registers.register_map(config),
        "bits": {name: of for name, of in BITS.items() if name in names},
        "errors": {code: meanings.get(code.name, "no error") for code in ErrorCode},
        "details": DETAILS,
        "fields": fields,
        "sizes": sizes(config),
        "model": {f"MODEL_{name.upper()}_AT": place for name, place in places.items()},
        "constants": camera_constants(config),
        "number": number_facts(config.arithmetic),
        "halves": HALVES,
        "view": {"VIEW_WORDS": view_words(config)},
        "layout": registers,
        "READERS": READERS,
        "WRITERS": WRITERS,
    }
    texts = {name: filled(f"deliver/{name}", **facts) for name in FILES}
    texts |= {name: Path(__file__).with_name(name).read_text() for name in DRIVER}
    texts = {renamed(name, prefix): renamed(text, prefix) for name, text in texts.items()}
    return write_texts(folder, texts)


def renamed(text: str, prefix: str) -> str:
    """Change the prefix of names in C and SystemRDL, and of files, in a text."""
    names = {PREFIX: prefix, PREFIX.upper(): prefix.upper()}
    found = rf"\b(?:{'|'.join(names)})(?=_|\.(?:h|rdl|xml)\b| \{{)"
    return re.sub(found, lambda name: names[name[0]], text)


def view_words(config: Config) -> int:
    """Number of registers that depend on background and camera: the last registers of a frame,
    without those for the upper bits of addresses."""
    names = [register.name for register in frame_registers(config)]
    return len(names) - len(high_registers(config)) - names.index("BACKGROUND_RED")


def sizes(config: Config) -> dict[str, int]:
    """Sizes for the host, by their names in C."""
    return {
        "WIDTH_MAX": config.width_max,
        "HEIGHT_MAX": config.height_max,
        "SH_DEGREE_MAX": config.sh_degree,
        "ADDRESS_BITS": config.address_bits,
        "SIDE_MAX": config.side_max,
        "GROUP_SIDE": TILE * config.group,
        "MODEL_ALIGNMENT": ALIGNMENT,
        "WORK_ALIGNMENT": WORK_ALIGNMENT,
        "SLOT_BYTES": SLOT,
        "PAGE_ENTRIES": config.page,
        "PAGE_BYTES": page_bytes(config),
        "FEATURE_BYTES": FEATURE,
        "SCRATCH_BYTES": scratch_bytes(config),
        "PIXEL_BYTES": PIXEL,
        "STRIDE_ALIGNMENT": STRIDE_ALIGNMENT,
    } | ({"PIXEL_RGBA_BYTES": PIXEL_RGBA} if config.rgba else {})


def camera_constants(config: Config) -> dict[str, float]:
    """Constants that the C driver needs to compute a camera's registers, as in `spec.frame`."""
    return {
        "NEAR": NEAR_PLANE,
        "SCREEN_EXPONENT": config.screen_exponent,
        "FRUSTUM_MARGIN": FRUSTUM_MARGIN,
        "PRINCIPAL_POINT_SHIFT": PRINCIPAL_POINT_SHIFT,
        "EXTENT_MARGIN": EXTENT_MARGIN,
        "SURROUND_MARGIN": SURROUND_MARGIN,
        "GUARD_FACTOR": 1 + GUARD_ROUNDINGS * config.arithmetic.epsilon,
        "BACKGROUND_FULL": (256 << config.colour_fraction) / 255,
    }


def number_facts(format: Float) -> dict[str, int | str]:
    """Facts for the C function that encodes numbers in a format."""
    infinity = format.overflow == "infinity"
    least, beyond = (frexp(value)[1] for value in (format.min_normal / 2, format.max))
    if format.subnormal:
        below = f"rint(ldexp(size, {format.fraction - least}))"
    else:
        below = f"size > least / 2 ? {1 << format.fraction}.0 : 0.0"
    return {
        "sign": format.width - 1,
        "least": least,
        "below": below,
        "beyond": beyond,
        "largest": int(format.encode(format.max)) + infinity,
        "fraction": format.fraction,
        "signed": "signbit(value)" if infinity else "value < 0 && code != 0",
    }
