"""Credits: a count of what is inside, from what comes and what goes."""

from amaranth.hdl import Elaboratable, Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.holds import holds


class Credit(wiring.Component):
    """Counts what is inside, from 0 to `most`: what has come and has not gone.

    Whoever pushes into a queue without a look at its `ready` lets something come only while there
    is `room`, and tells what goes when it leaves the queue. Every simulation and every proof stops
    (`hdl.lib.holds`) where less than nothing or more than `most` would be inside. What comes may go
    in the same cycle, and what goes makes room for what comes in that cycle.

    Parameters
        what: is counted, for the message of the assertion.
        step: how many may come in a cycle.
        begin: how many are inside after reset.

    Members
        comes: how many come in this cycle, 0 … `step`; goes: one goes.
        count: how many are inside; room: there is room for one more; any: something is inside.

    **Timing**: `count`, `room` and `any` are of the cycles before. No path. The flip-flops of
    `count`; no multiplier.
    """

    def __init__(self, most: int, what: str, *, step: int = 1, begin: int = 0):
        if not 1 <= step <= most:
            raise ValueError(f"{what}: {step} may come at once, and {most} be inside")
        ports = {
            "comes": In(range(step + 1)),
            "goes": In(1),
            "count": Out(range(most + 1), init=begin),
            "room": Out(1),
            "any": Out(1),
        }
        super().__init__(ports)
        self.most, self.step, self.what = most, step, what

    def elaborate(self, platform) -> Module:
        m = Module()
        count, comes, goes = self.count, self.comes, self.goes
        m.d.comb += [self.room.eq(count != self.most), self.any.eq(count.any())]
        then = count + comes - goes
        m.d.sync += count.eq(then)
        inside = (then >= 0) & (then <= self.most)
        holds(m, "count", inside, f"less than nothing or more than {self.most}: {self.what}")
        return m


class _Within(Elaboratable):
    """A `Credit` in simulations alone."""

    def __init__(self, comes: Value, goes: Value, most: int, what: str, begin: int):
        self.comes, self.goes = comes, goes
        self.most, self.what, self.begin = most, what, begin

    def elaborate(self, platform) -> Module:
        m = Module()
        if platform is None:
            m.submodules.count = count = Credit(self.most, self.what, begin=self.begin)
            m.d.comb += [count.comes.eq(self.comes), count.goes.eq(self.goes)]
        return m


def within(m: Module, name: str, comes: Value, goes: Value, most: int, what: str, begin: int = 0):
    """Has simulations stop if, of what comes and goes, there is less than nothing or more than
    `most` at a time; counts nothing in what is built. begin: how many there are after reset."""
    m.submodules[f"within_{name}"] = _Within(comes, goes, most, what, begin)
