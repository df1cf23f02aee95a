"""Alpha of blocks that the lanes output, 8 bits per pixel (`Config.rgba`)."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import data

from splatcore.spec.config import Config
from splatcore.spec.pixel import alpha_code
from splatcore.spec.raster import COLOURS


def output_alpha(m: Module, config: Config, o: data.View, stored: data.View, stages: list[tuple]):
    """Add alpha to a block that is output: of its T before it is reset, in step with its colours.

    o: the output pixels
    stored: T of the block in the first of `stages`
    stages: valid bits and registers of the lanes' stages
    """
    alphas = Cat(alpha_code(config, pixel[: config.transmittance])[:8] for pixel in stored)
    for number, _ in enumerate(stages[1:]):
        held = Signal(len(alphas), name=f"alphas{number}", reset_less=True)
        m.d.sync += held.eq(alphas)
        alphas = held
    _, last = stages[-1]
    for pixel, own in enumerate(o):
        m.d.comb += own[len(COLOURS)].eq(Mux(last.untouched, 0, alphas.word_select(pixel, 8)))
