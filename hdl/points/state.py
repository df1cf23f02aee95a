"""Registers that stages 0 and 1 use during a frame: those of the frame, and those of its model."""

from amaranth.hdl import signed
from amaranth.lib import data

from splatcore.spec.colour import DEGREES
from splatcore.spec.config import Config
from splatcore.spec.frame import CAMERA
from splatcore.spec.microprogram import constants
from splatcore.spec.point import EXPONENT, GAUSSIAN_BITS


def codes(config: Config, names: tuple[str, ...]) -> data.StructLayout:
    """Layout with a float of `Config.arithmetic` for each name."""
    return data.StructLayout({name: config.arithmetic.width for name in names})


def frame_state(config: Config) -> data.StructLayout:
    """Registers of the frame, stable while one of its points is inside."""
    return data.StructLayout({
        "camera": data.ArrayLayout(signed(CAMERA.width), 3),  # its position in grid steps
        "near_plane": config.arithmetic.width,  # a float
        "constants": codes(config, constants(config)),  # of all microprograms
    })  # fmt: skip


class ModelState(data.Struct):
    """Fields of the model's header, stable from the end of its reading until the next frame."""

    gaussians: GAUSSIAN_BITS  # their number
    sh: 1  # it has harmonics: its degree is above 0
    codebooks: 1  # it is compact; if colours are computed in the array every model is
    small: 1  # it has half a beat of attributes per Gaussian; only with `Config.small_models`
    antialiased: 1  # opacities are to be compensated; only with `Config.compensates`
    position_exponent: signed(EXPONENT.width)  # E of positions
    exponent: data.ArrayLayout(signed(EXPONENT.width), DEGREES)  # E of colours, of each degree
