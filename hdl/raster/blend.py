"""Stage 3, sixth step: the lanes that blend a splat into a block, and the memories of pixels."""

from collections.abc import Iterable
from functools import partial

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.hdl.raster.alpha import output_alpha
from splatcore.hdl.raster.evaluate import log2_alpha_layout
from splatcore.hdl.raster.mark import times
from splatcore.hdl.raster.pixel_words import PixelWords
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.raster import (
    COLOURS,
    HALVING_BITS,
    SUM_INTEGER,
    colours,
    mark_min,
    power_table,
    transmittance_min,
)
from splatcore.spec.record import Record
from splatcore.spec.work import pixel_bytes

PIXELS = BLOCK**2


class Blend(wiring.Component):
    """Blends pixel by pixel: reads T and the colour, weights the splat by T·alpha, writes both
    back.

    A pixel whose T would fall below the minimum terminates: it does not change any more. Invisible
    contributions are left out (`Config.faint`); then a pixel's last splat takes the rest of T. A
    block that is touched for the first time in a group begins with T of almost 1 and no colour.
    Weights are differences of T truncated to few bits: the next weight includes what one weight
    lacks, so that their sum is the decrease of T.

    Parameters:
        blocks: number of blocks in the memories
        pixels: pixels per block; fewer are useful for measurements
        heads: number of operations to choose from; with several the caller checks `waits`, and says
            which blocks are `untouched`

    **Timing**: one block per cycle, the same block again after `BUSY` cycles; each of the 16 lanes
    has one multiplier, or four (`Config.logic`). Each pixel of a block has two memories, one of T
    and one of its sums, with a write port and a read port each. Sums are read, and both are
    written, only for pixels that change, or whose block is touched for the first time or output.
    """

    BUSY = 4
    LATENCY = 5  # cycles from a block to its colours at `o`; 4 with multipliers

    def __init__(self, config: Config, blocks: int, pixels: int = PIXELS, heads: int = 1):
        self.config, self.blocks, self.pixels, self.heads = config, blocks, pixels, heads
        self.number = range(blocks)
        self.colour_shape = layout(Record("colour", colours(config)))
        ports = {
            "valid": In(1),  # an operation on `block`
            "block": In(self.number),  # number of the block in the memory
            # of the block's pixels
            "log2_alphas": In(data.ArrayLayout(log2_alpha_layout(config), self.pixels)),
            "colour": In(self.colour_shape),  # of the splat
            # one bit per pixel: it is within the image; the others are terminated from the start
            "inside": In(self.pixels),
            "give": In(1),  # the block is output and reset
            "blends": In(1),  # a splat is blended into the block, after `give`
            "rest": In(1),  # all of the remaining T is blended with the colour
            "busy": Out(1),  # `block` cannot be blended now
            "entered": Out(1),  # in the two cycles before, a block to be blended was taken
            "blended": Out(1),  # block `blended_block` has been blended, or (`heads`) reset
            "blended_block": Out(self.number),  # its number
            "ended": Out(1),  # all its pixels are terminated
            # one bit for each level of `spec.raster.mark_min` from 1 on: it is at it or above
            "level": Out(len(mark_min(config)) - 1),
            "giving": Out(1),  # a block to be output is in flight
            "given": Out(1),  # `o` is valid
            "given_block": Out(self.number),  # number of the block at `o`
            # 8-bit colours of the block's pixels, and alpha if the machine has it
            "o": Out(data.ArrayLayout(data.ArrayLayout(8, pixel_bytes(config.rgba)), self.pixels)),
        }
        if config.logic == "fpga":
            # `block` of the next cycle, unless this one is valid and has to wait
            ports["coming"] = In(self.number)
        if heads > 1:
            ports["choices"] = In(data.ArrayLayout(self.number, heads))  # blocks to choose from
            ports["waits"] = Out(heads)  # one bit per choice: it cannot be blended now
            ports["untouched"] = In(1)  # no splat was blended into `block` since it was output
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        # On an FPGA lanes have no enables of their own, and pixels share block RAM.
        self.joint = self.config.logic == "fpga"
        self.words = partial(PixelWords, blocks=self.blocks, pixels=self.pixels, joint=self.joint)
        m.submodules.transmittances = words = self.words(self.config.transmittance + 1)
        asked = self._look_up(m, words.read)
        read = self._read(m, words.found, *asked)
        product = self._multiply(m, *read)
        taken = self._subtract(m, words.write, *product)
        stages = [asked, read, product, taken]
        parts = self._weight(m, stages)
        on_the_way = (valid & stage.give for valid, stage in stages)
        entered = (valid & stage.blends for valid, stage in (asked, read))
        m.d.comb += [self.giving.eq(Cat(on_the_way).any()), self.entered.eq(Cat(entered).any())]
        self._wait(m, asked, read, product)
        self._add(m, stages[-2], stages[-1], parts)
        if self.config.rgba:
            output_alpha(m, self.config, self.o, words.found, stages)
        return m

    def _wait(self, m: Module, *stages: tuple):
        """Whether a block has to wait for itself.

        On an FPGA this is computed a cycle earlier, from the stages that remain then, because the
        logic behind it is far away.
        """

        def within(block: Value, stages: Iterable[tuple]) -> Value:
            return Cat(valid & (stage.block == block) for valid, stage in stages).any()

        if self.config.logic == "fpga":
            left = stages[:-1]
            moves = within(self.coming, [*left, (self.valid, self)])
            stays = within(self.block, left)
            m.d.sync += self.busy.eq(Mux(self.valid & self.busy, stays, moves))
        else:
            m.d.comb += self.busy.eq(within(self.block, stages))
        if self.heads > 1:
            m.d.comb += self.waits.eq(Cat(within(block, stages) for block in self.choices))

    def _stage(self, m: Module, name: str, lane: dict, valid: Value, source) -> tuple:
        """Registers of a stage, some of them per lane, which the caller loads; their valid bit."""
        shared = {"block": self.number, "colour": self.colour_shape}
        shared |= dict.fromkeys(("untouched", "give", "blends", "rest"), 1)
        lanes = data.ArrayLayout(data.StructLayout(lane), self.pixels)
        stage = Signal(data.StructLayout({"lanes": lanes} | shared), name=name, reset_less=True)
        stage_valid = Signal(name=f"{name}_valid")
        m.d.sync += stage_valid.eq(valid)
        with m.If(valid):
            m.d.sync += [stage[field].eq(getattr(source, field)) for field in shared]
        return stage_valid, stage

    def _look_up(self, m: Module, words: data.View) -> tuple[Signal, data.View]:
        """Request T, of all pixels: whether the block has live ones depends on all."""
        fire = self.valid & ~self.busy
        for read in words:
            m.d.comb += [read.enable.eq(fire), read.block.eq(self.block)]
        if self.heads == 1:
            self.touched = Signal(self.blocks)
            self.untouched = ~self.touched.bit_select(self.block, 1)
        lane = {"log2_alpha": log2_alpha_layout(self.config), "inside": 1}
        valid, asked = self._stage(m, "asked", lane, fire, self)
        with m.If(fire):
            for pixel, lane in enumerate(asked.lanes):
                m.d.sync += lane.log2_alpha.eq(self.log2_alphas[pixel])
                m.d.sync += lane.inside.eq(self.inside[pixel])
        return valid, asked

    def _read(self, m: Module, stored: data.View, valid: Signal, asked: data.View) -> tuple:
        """T; alpha's mantissas from the table."""
        config = self.config
        if self.heads == 1:
            with m.If(valid):
                m.d.sync += self.touched.bit_select(asked.block, 1).eq(asked.blends)
        lane = {"mantissa": config.power_mantissa, "halvings": HALVING_BITS, "seen": 1}
        lane |= {"rest": config.transmittance, "ended": 1}
        read_valid, read = self._stage(m, "read", lane, valid, asked)
        table = Array(Const(entry, config.power_mantissa) for entry in power_table(config))
        full, fresh = (1 << config.transmittance) - 1, asked.untouched | asked.give
        for pixel, (lane, to) in enumerate(zip(asked.lanes, read.lanes, strict=True)):
            word = stored[pixel]
            with m.If(valid):
                m.d.sync += [
                    to.seen.eq(lane.log2_alpha.seen),
                    to.rest.eq(Mux(fresh, full, word[: config.transmittance])),
                    to.ended.eq(Mux(fresh, ~lane.inside, word[-1])),
                ]
            with m.If(valid & (lane.log2_alpha.seen | self.joint)):
                m.d.sync += [
                    to.mantissa.eq(table[lane.log2_alpha.step]),
                    to.halvings.eq(lane.log2_alpha.halvings),
                ]
        return read_valid, read

    def _multiply(self, m: Module, valid: Signal, read: data.View) -> tuple:
        """T · mantissa."""
        config = self.config
        lane = {"product": config.transmittance + config.power_mantissa, "halvings": HALVING_BITS}
        lane |= {"rest": config.transmittance, "ended": 1, "seen": 1}
        product_valid, product = self._stage(m, "product", lane, valid, read)
        for lane, to in zip(read.lanes, product.lanes, strict=True):
            with m.If(valid):
                m.d.sync += [to[name].eq(lane[name]) for name in ("rest", "ended", "seen")]
            with m.If(valid & (lane.seen | self.joint)):
                m.d.sync += to.product.eq(lane.rest * lane.mantissa)
                m.d.sync += to.halvings.eq(lane.halvings)
        return product_valid, product

    def _subtract(self, m: Module, kept: data.View, valid: Signal, before: data.View) -> tuple:
        """Subtract the splat's share from T; write T back where it changes."""
        config = self.config
        lane = {"weight": config.weight, "changes": 1}
        taken_valid, stage = self._stage(m, "taken", lane, valid, before)
        blended, fresh = valid & before.blends & ~before.rest, before.untouched | before.give
        coarser, ended = config.transmittance - config.weight, Signal(self.pixels)
        bits, levels = config.transmittance, len(self.level)
        bright = [0] * levels  # per level: pixels whose T is too high for it
        for pixel, (lane, to) in enumerate(zip(before.lanes, stage.lanes, strict=True)):
            taken = Signal(config.transmittance, name=f"taken_{pixel}")
            rest = Signal(config.transmittance + 1, name=f"rest_{pixel}")
            acts, ends = Signal(name=f"acts_{pixel}"), Signal(name=f"ends_{pixel}")
            after = Signal.like(lane.rest)
            faint, last = Const(0), lane.rest
            if rule := config.faint:
                faint = ~lane.rest[bits - rule.dark :].any() & ~taken[bits - rule.taken :].any()
                last = Const(0)
            m.d.comb += [
                taken.eq((lane.product >> config.power_mantissa) >> lane.halvings),
                rest.eq(lane.rest - taken),
                acts.eq(lane.seen & ~lane.ended & ~faint),
                ends.eq(acts & (rest < transmittance_min(config))),
                ended[pixel].eq(lane.ended | ends),
                after.eq(Mux(ends, last, Mux(acts, rest[:-1], lane.rest))),
                kept[pixel].enable.eq(blended & (acts | fresh | self.joint)),
                kept[pixel].block.eq(before.block),
                kept[pixel].word.eq(Cat(after, ended[pixel])),
            ]
            less = Mux(before.rest, 0, after[coarser:])
            changes = before.blends & (acts | fresh | before.rest | self.joint)
            with m.If(valid):
                m.d.sync += to.changes.eq(changes)
            with m.If(valid & changes):
                m.d.sync += to.weight.eq(lane.rest[coarser:] - less)
            for k in range(levels):
                bright[k] |= after[bits - config.faint.dark - k :].any() & ~ended[pixel]
        if self.heads > 1:
            blended = valid & (before.blends | before.give) & ~before.rest
        m.d.comb += [self.blended.eq(blended), self.blended_block.eq(before.block)]
        m.d.comb += [self.ended.eq(ended.all()), self.level.eq(~Cat(bright))]
        return taken_valid, stage

    def _weight(self, m: Module, stages: list[tuple]) -> list[list[Value]]:
        """weight · colour, rounded to the sums' steps: for each pixel, for each channel.

        Two bits of the weight at a time select 0, 1, 2 or 3 times the colour (the triple is
        computed once for all lanes), followed by registers, which are one more of `stages`; or it
        is a multiplier (`Config.logic`).
        """
        (product_valid, product), taken = stages[-2:]
        config = self.config
        gates = config.logic == "gates"
        below = config.weight + config.colour_fraction - config.sum_fraction
        channels = []
        for name in COLOURS:
            colour = taken[1].colour[name]
            if gates:
                triple = Signal(len(colour) + 2, name=f"triple_{name}", reset_less=True)
                with m.If(product_valid):
                    m.d.sync += triple.eq(times(product.colour[name], 3))
                multiples = Array([Const(0), colour, colour << 1, triple])
                digits = range(0, config.weight, 2)
                weighted = [
                    sum(multiples[lane.weight[k : k + 2]] << k for k in digits)
                    for lane in taken[1].lanes
                ]
            else:
                weighted = [lane.weight * colour for lane in taken[1].lanes]
            channels.append([(each + (1 << below - 1)) >> below for each in weighted])
        if not gates:
            return list(zip(*channels, strict=True))
        lane = {name: config.weight + len(taken[1].colour[name]) - below for name in COLOURS}
        valid, stage = self._stage(m, "weighted", lane | {"changes": 1}, *taken)
        stages.append((valid, stage))
        parts = list(zip(*channels, strict=True))
        for before, to, part in zip(taken[1].lanes, stage.lanes, parts, strict=True):
            with m.If(taken[0]):
                m.d.sync += to.changes.eq(before.changes)
            with m.If(taken[0] & before.changes):
                m.d.sync += [to[name].eq(value) for name, value in zip(COLOURS, part, strict=True)]
        return [[lane[name] for name in COLOURS] for lane in stage.lanes]

    def _add(self, m: Module, before: tuple, stage: tuple, parts: list):
        """Add weight · colour to the sums; convert the sums to 8-bit colours.

        before: the stage in which the sums are read
        stage: the stage in which they are written
        parts: results of `_weight`, in step with `stage`
        """
        config = self.config
        (entering, next_), (valid, taken) = before, stage
        pixel_sums = data.ArrayLayout(SUM_INTEGER + config.sum_fraction, len(COLOURS))
        m.submodules.sums = sums = self.words(pixel_sums)
        for pixel, (read, write) in enumerate(zip(sums.read, sums.write, strict=True)):
            changes = Const(1) if self.joint else next_.lanes[pixel].changes
            m.d.comb += [
                read.enable.eq(entering & ~next_.untouched & (next_.give | changes)),
                read.block.eq(next_.block),
                write.enable.eq(valid & taken.lanes[pixel].changes),
                write.block.eq(taken.block),
            ]
        m.d.comb += [self.given.eq(valid & taken.give), self.given_block.eq(taken.block)]
        fresh = taken.untouched | taken.give
        for channel in range(len(COLOURS)):
            for pixel in range(self.pixels):
                stored, part = sums.found[pixel][channel], parts[pixel][channel]
                m.d.comb += sums.write[pixel].word[channel].eq(Mux(fresh, 0, stored) + part)
                byte = (stored + (1 << config.sum_fraction - 9)) >> (config.sum_fraction - 8)
                byte = Mux(byte[8:].any(), 255, byte[:8])
                m.d.comb += self.o[pixel][channel].eq(Mux(taken.untouched, 0, byte))
