"""Stage 3, fifth step: evaluates log2(alpha) of a block's 16 pixels."""

from itertools import islice, product

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.latency import Pipeline
from splatcore.hdl.lib.record import layout
from splatcore.hdl.raster.mark import plus, times
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.raster import (
    BLOCKS,
    EXPONENT_INTEGER,
    HALVING_BITS,
    STEPS,
    exponent_min,
    owned,
    quadratic_record,
)

CUTS = ("multiples", "block", "lines", "exponents")  # registers are behind these values


def log2_alpha_layout(config: Config) -> data.StructLayout:
    """A pixel's alpha, 2^(−halvings − 1 + (step + 1/2) / steps). seen: it is at least 1/255."""
    return data.StructLayout({"step": config.power_fraction, "halvings": HALVING_BITS, "seen": 1})


class Evaluate(wiring.Component):
    """E = log2(alpha) at the 16 pixels of one of the blocks that a rasterizer owns.

    Parameters:
        rasterizer: its number
        pixels: number of pixels, from the first row on; fewer are useful for measurements

    **Timing**: one block per cycle; no multiplier.
    """

    LATENCY = len(CUTS)

    def __init__(self, config: Config, rasterizer: int, pixels: int = BLOCK**2):
        self.config, self.blocks, self.pixels = config, owned(config, rasterizer), pixels
        ports = {
            "quadratic": In(layout(quadratic_record(config))),  # E around the tile
            "number": In(len(self.blocks)),  # one-hot, which of the rasterizer's blocks of a tile
            "enable": In(self.LATENCY),  # bit k: a block enters the registers of the k-th cut
            # of the pixels row by row, `LATENCY` enabled cycles later
            "log2_alphas": Out(data.ArrayLayout(log2_alpha_layout(config), pixels)),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        pipeline = Pipeline(m, self.enable, dict.fromkeys(CUTS, 1))
        coarser = self.config.exponent_fraction + 2 - self.config.pixel_fraction
        # A pixel's E is above −147 in a block that is reached, so higher bits may wrap.
        width = EXPONENT_INTEGER + self.config.pixel_fraction
        unsigned = ("cxx", "cyy")
        finer = [
            self.quadratic[name] if name in unsigned else self.quadratic[name].as_signed()
            for name in ("e", "gx", "gy", "cxx", "cxy", "cyy")
        ]
        multiples = self._multiples(*finer)
        *multiples, e, gx, gy, cxx, cxy, cyy = pipeline.cut("multiples", *multiples, *finer)
        x, y, xx, xy, yy, x_slope, xy_slope, y_slope, yx_slope = multiples
        base = e + ((x + y) << 1) - ((xx + yy - xy) << 2)
        slope_x = gx - (x_slope << 2) + (xy_slope << 1)
        slope_y = gy - (y_slope << 2) + (yx_slope << 1)
        values = (base << 2, slope_x << 1, slope_y << 1, cxx, cxy, cyy)
        base, along_x, along_y, xx, xy, yy = pipeline.cut("block", *(v >> coarser for v in values))
        columns = [base + (times(along_x, a) - times(xx, a * a)) for a in STEPS]
        rows = [times(along_y, b) - times(yy, b * b) for b in STEPS]
        columns, rows = ([line[:width].as_signed() for line in lines] for lines in (columns, rows))
        factors = sorted({abs(a * b) for a, b in product(STEPS, STEPS)})
        lines = pipeline.cut("lines", *columns, *rows, *(times(xy, f) for f in factors))
        columns, rows, multiples = lines[:BLOCK], lines[BLOCK : 2 * BLOCK], lines[2 * BLOCK :]
        multiples = {("xy", f): part for f, part in zip(factors, multiples, strict=True)}
        log2_alphas = []
        positions = product(zip(rows, STEPS, strict=True), zip(columns, STEPS, strict=True))
        for (row, b), (column, a) in islice(positions, self.pixels):
            exponent = plus(column + row, multiples, "xy", a * b, 0)[:width].as_signed()
            log2_alphas.append(self._log2_alpha(m, exponent))
        m.d.comb += self.log2_alphas.eq(Cat(*pipeline.cut("exponents", *log2_alphas)))
        return m

    def _multiples(self, e, gx, gy, cxx, cxy, cyy) -> list[Value]:
        """Products with the block's p and q, as named in `spec.raster`."""
        steps = [(STEPS[block % BLOCKS], STEPS[block // BLOCKS]) for block in self.blocks]
        return [
            self._choose(value, [factor(p, q) for p, q in steps])
            for value, factor in (
                (gx, lambda p, q: p), (gy, lambda p, q: q),
                (cxx, lambda p, q: p * p), (cxy, lambda p, q: p * q), (cyy, lambda p, q: q * q),
                (cxx, lambda p, q: p), (cxy, lambda p, q: q),
                (cyy, lambda p, q: q), (cxy, lambda p, q: p),
            )
        ]  # fmt: skip

    def _choose(self, value: Value, factors: list[int]) -> Value:
        """value · the factor of the selected block."""
        chosen = value
        sizes = [abs(factor) for factor in factors]
        for size in (3, 9):
            if size in sizes:
                is_size = Cat(self.number[k] for k, s in enumerate(sizes) if s == size).any()
                chosen = Mux(is_size, times(value, size), chosen)
        negative = [self.number[k] for k, factor in enumerate(factors) if factor < 0]
        return Mux(Cat(negative).any(), -chosen, chosen) if negative else chosen

    def _log2_alpha(self, m: Module, exponent: Value) -> Value:
        """`log2_alpha_layout` of E; an E that rounding raised to 0 or more counts as just below."""
        config = self.config
        log2_alpha = Signal(log2_alpha_layout(config))
        step = config.pixel_fraction - config.power_fraction
        top = step + config.power_fraction
        positive = ~exponent[-1]
        below = Mux(positive, -1, exponent[step:])
        m.d.comb += log2_alpha.step.eq(below[: config.power_fraction])
        m.d.comb += log2_alpha.halvings.eq(~below[config.power_fraction :][:HALVING_BITS])
        m.d.comb += log2_alpha.seen.eq(exponent >= exponent_min(config.pixel_fraction))
        assert top + HALVING_BITS < len(exponent)
        return log2_alpha
