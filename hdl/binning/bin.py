"""Binning: writes splats as features in order, and to lists of the groups of tiles they touch."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.arithmetic.convert import Convert, ToFixed, converted
from splatcore.hdl.binning.gather import Gather
from splatcore.hdl.binning.list_writer import ListWriter
from splatcore.hdl.binning.outline import Outline
from splatcore.hdl.binning.rows import Rows
from splatcore.hdl.lib.counters import count_events, counters_layout
from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import Queue, Register, Slot, Stage, passes
from splatcore.spec import convention, counters, point
from splatcore.spec.binning import PAGE_BITS, burst_record, group_record
from splatcore.spec.colour import scaled_colours, unscaled_colour_format
from splatcore.spec.config import Config
from splatcore.spec.depth import base_code, below_bits, below_shift, key_shift, low_bits
from splatcore.spec.feature import (
    FACTOR,
    FACTOR_SCALE,
    POSITION,
    SCALE_MAX,
    SHEAR,
    feature_record,
    short_colours,
)
from splatcore.spec.group import SPLAT_BITS, key_format
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Fixed
from splatcore.spec.raster import COLOURS

COUNTED = tuple(counters.BIN)

SPLATS_INSIDE = 32  # splats whose tiles are not yet known


class Bin(wiring.Component):
    """Turns splats into features (if they touch a tile), bursts of list slots, and lists of groups.

    A splat that touches a tile gets the next number of the frame; its entries, one per group of
    tiles, carry that number. `spec.binning` defines the tiles that it touches and explains why none
    is missing.

    **Timing**: one tile row, one entry or a third of a splat per cycle, whichever is slowest;
    latency about 25 from a splat to its first entry. Multipliers as in `hdl.binning.rows`.
    """

    def __init__(self, config: Config):
        self.config = config
        self.outline, self.rows = Outline(config), Rows(config)
        self.gather, self.lists = Gather(config), ListWriter(config)
        ports = {
            "i": In(stream_of(point.splat_record(config))),
            # of the image, pixels; stable from two cycles before the frame
            "width": In(range(config.side_max + 1)),
            "height": In(range(config.side_max + 1)),
            "pages": In(PAGE_BITS),  # pages of list memory; stable from two cycles before the frame
            # the frame's last splat has been taken; when all is written, `groups` follow, then
            # `done` stays high until `finish` is low, which begins the next frame
            "finish": In(1),
            "features": Out(stream_of(feature_record(config))),  # in the order of their numbers
            "bursts": Out(stream_of(burst_record(config))),
            "groups": Out(stream_of(group_record())),  # all groups of the image in order
            # pages that the frame takes, valid until the next frame begins
            "needed": Out(PAGE_BITS),
            # `needed` is above `pages`: bursts in missing pages are dropped, all else goes on
            "exceeded": Out(1),
            "done": Out(1),  # the frame is complete
            "clear": In(1),  # all counters are 0
            # counts of `COUNTED`; `blocked` counts cycles in which an output is not taken
            "counters": Out(counters_layout(COUNTED)),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.outline, m.submodules.rows = self.outline, self.rows
        m.submodules.gather, m.submodules.lists = self.gather, self.lists
        m.submodules.arrives = self.arrives = Stage(self.i.payload.shape())
        connect(m, flipped(self).i, self.arrives.i)
        connect(m, self.outline.o, self.rows.i)
        connect(m, self.rows.o, self.gather.i)
        m.submodules.parts = self.parts = Register(self.gather.o.payload.shape())
        connect(m, self.gather.o, self.parts.i)
        m.submodules.entries = self.entries = Register(self.lists.i.payload.shape())
        connect(m, self.entries.o, self.lists.i)
        ends = {
            "features": Slot(self.features.payload.shape()),
            "bursts": Slot(self.bursts.payload.shape()),
            "groups": Register(self.groups.payload.shape()),
        }
        for name, part in ends.items():
            m.submodules[name] = part
            connect(m, part.o, flipped(getattr(self, name)))
        connect(m, self.lists.bursts, ends["bursts"].i)
        connect(m, self.lists.groups, ends["groups"].i)
        self.kept_features = ends["features"].i
        m.d.comb += [
            self.outline.width.eq(self.width),
            self.outline.height.eq(self.height),
            self.rows.width.eq(self.width),
            self.lists.pages.eq(self.pages),
            self.needed.eq(self.lists.needed),
            self.exceeded.eq(self.lists.exceeded),
            self.done.eq(self.lists.done & ~Cat(part.o.valid for part in ends.values()).any()),
        ]
        inside = self.outline.o.valid | self.rows.busy | self.gather.busy | self.parts.o.valid
        inside |= self.arrives.o.valid  # the lists check their own input
        with m.If(self.finish):
            m.d.comb += self.lists.finish.eq(self.lists.done | ~(self.i.valid | inside))
        kept = self._join(m, self._splats(m), self._group(m))
        self._count(m, kept)
        return m

    def _splats(self, m: Module) -> stream.Interface:
        """Features and depth keys, which wait until their splats' tiles are known."""
        format, splat, i = self.config.arithmetic, self.arrives.o.payload, self.arrives.o
        colour = unscaled_colour_format(self.config)
        floats = dict.fromkeys(("u", "v", "shear", "across", "along"), format.width)
        shape = data.StructLayout(
            floats
            | {"scale": SCALE_MAX.bit_length(), "opacity": OPACITY.width}
            | dict.fromkeys(COLOURS, colour.width)
            | {"key": key_format(self.config).width}
        )
        m.submodules.splats = queue = Queue(shape, SPLATS_INSIDE, memory=True)
        waits = queue.i.payload
        for name in floats:
            source = splat[f"power_{name}" if name in ("across", "along") else name]
            m.d.comb += waits[name].eq(source)
        steps = Fixed(OPACITY.width, 0)
        fixed = {"opacity": (steps, splat.attenuation)}
        for name in COLOURS:
            if self.config.colours == "array":
                fixed[name] = colour, splat[name]
            else:
                m.d.comb += waits[name].eq(splat[name])
        for name, (target, source) in fixed.items():
            convert = ToFixed(format, target, 0)
            m.d.comb += waits[name].eq(converted(m, f"fixed_{name}", convert, source))
        m.d.comb += waits.scale.eq(self._scale(splat.u, splat.v))

        m.d.comb += [
            queue.i.payload.key.eq(self._key(splat)),
            self.outline.room.eq(queue.i.ready),
            self.outline.i.payload.eq(splat),
            self.outline.i.valid.eq(i.valid),
            i.ready.eq(self.outline.i.ready),
            queue.i.valid.eq(i.valid & i.ready & self.outline.seen),
        ]
        m.submodules.head, m.submodules.waited = head, waited = Stage(shape), Stage(shape)
        connect(m, queue.o, head.i)
        connect(m, head.o, waited.i)
        self._centre(m, waited.i.payload, waited.i.ready)
        return waited.o

    def _centre(self, m: Module, splat: data.View, enable: Value):
        """A centre in the format of features; the shifted value is held while `waited` holds the
        splat.
        """
        unit, between = self.config.screen_exponent, {"shift": 1, "round": 0}
        scales = range(unit - SCALE_MAX, unit + 1)
        self.centre = {
            name: ToFixed(self.config.arithmetic, POSITION, between, scales) for name in ("u", "v")
        }
        for name, fixed in self.centre.items():
            m.submodules[name] = fixed
            m.d.comb += [fixed.i.eq(splat[name]), fixed.enable.eq(enable)]
            m.d.comb += fixed.scale.eq(unit - splat.scale)

    def _scale(self, u: Value, v: Value) -> Value:
        """`spec.feature.centre_codes`, from the exponents."""
        format, unit = self.config.arithmetic, self.config.screen_exponent
        u, v = (code[format.fraction :][: format.exponent] for code in (u, v))
        farther = Mux(u > v, u, v)
        beyond = farther - (format.bias - unit - 1 + POSITION.integer)
        beyond = Mux(beyond < 0, 0, Mux(beyond > SCALE_MAX, SCALE_MAX, beyond))
        if format.overflow == "infinity":
            beyond = Mux(farther.all(), SCALE_MAX, beyond)
        return beyond

    def _features(self, m: Module, splat: data.View) -> dict[str, Value]:
        """The fields of `feature_record` for the splat that has waited."""
        format, unit = self.config.arithmetic, self.config.screen_exponent
        found = {"scale": splat.scale, "opacity": splat.opacity}
        found |= {name: fixed.o for name, fixed in self.centre.items()}
        for name in ("across", "shear", "along"):
            factor = FACTOR, 0, FACTOR_SCALE - 2 * unit
            convert = Convert(format, *((SHEAR, 0) if name == "shear" else factor))
            found[name] = converted(m, name, convert, splat[name])
        for name in COLOURS:
            found[name] = short_colours(self.config, scaled_colours(splat[name]), Mux)
        return found

    def _key(self, splat: data.View) -> Value:
        """The key of a splat's depth (`spec.depth`)."""
        config, width = self.config, self.config.sort_key_bits
        bits, shift, first = low_bits(config), key_shift(config), below_bits(config)
        half = 1 << bits >> 1
        whole = Cat(splat.z_low ^ half, splat.z) if bits else splat.z
        if not shift:
            steps = whole - half
            return Mux(steps < 0, 0, steps)[:width]
        steps = whole - (base_code(config) + half)
        coarse = Cat(steps[shift : shift + width - 2], Const(3, 2))
        middle = Cat(steps[1 : width - 1], Const(2, 2))
        fine = steps[: width - 1]
        above = Mux(steps[width:-1].any(), coarse, Mux(steps[width - 1], middle, fine))
        above = Cat(above[:first], (above[first:] + 1)[: width - first])
        down = steps[below_shift(config) :]  # negative: its lower bits are 2^first + down
        below = Mux(down[first:].all(), down[:first], 0)
        return Mux(steps < 0, below, above)

    def _group(self, m: Module) -> Value:
        """The number of a part's group."""
        part, side = self.parts.o.payload, exact_log2(convention.TILE * self.config.group)
        columns = Signal(range((self.config.side_max >> side) + 2))
        rows = Signal(range((self.config.side_max >> side) + 2))
        m.d.sync += columns.eq((self.width + (1 << side) - 1) >> side)
        m.d.sync += rows.eq((self.height + (1 << side) - 1) >> side)
        m.d.sync += self.lists.groups_count.eq(rows * columns)
        return part.row * columns + part.column

    def _join(self, m: Module, splat: stream.Interface, group: Value) -> Value:
        """Parts of splats become entries, and with a splat's last part the splat becomes a feature.

        A part is done when both are taken. Returns whether a kept splat is done.
        """
        part, entry, number = self.parts.o, self.entries.i, Signal(SPLAT_BITS)
        touched, had_entry, had_feature = Signal(), Signal(), Signal()
        features = self.kept_features
        some = part.payload.mask.any()
        both = part.valid & splat.valid
        kept = part.payload.last & (touched | some)
        through = Signal()
        m.d.comb += [
            entry.valid.eq(both & some & ~had_entry),
            entry.payload.group.eq(group),
            entry.payload.entry.key.eq(splat.payload.key),
            entry.payload.entry.splat.eq(number),
            entry.payload.entry.mask.eq(part.payload.mask),
            features.valid.eq(both & kept & ~had_feature),
            *(
                features.payload[name].eq(value)
                for name, value in self._features(m, splat.payload).items()
            ),
            through.eq(
                both & (~some | had_entry | entry.ready) & (~kept | had_feature | features.ready)
            ),
            part.ready.eq(through),
            splat.ready.eq(through & part.payload.last),
        ]
        m.d.sync += [
            had_entry.eq(~through & (had_entry | (entry.valid & entry.ready))),
            had_feature.eq(~through & (had_feature | passes(features))),
        ]
        with m.If(through):
            m.d.sync += touched.eq(~part.payload.last & (touched | some))
            with m.If(kept):
                m.d.sync += number.eq(number + 1)
        with m.If(self.done):
            m.d.sync += number.eq(0)
        return through & kept

    def _count(self, m: Module, kept: Value):
        entry, outputs = self.entries.i, (self.features, self.bursts, self.groups)
        events = {
            "splats": self.i.valid & self.i.ready,
            "kept": kept,
            "rows": self.rows.row,
            "entries": entry.valid & entry.ready,
            "bursts": self.bursts.valid & self.bursts.ready,
            "blocked": Cat(o.valid & ~o.ready for o in outputs).any(),
        }
        count_events(m, self, events)
