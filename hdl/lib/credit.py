"""Credits: a count of the items in flight."""

from amaranth.hdl import Elaboratable, Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.holds import holds


class Credit(wiring.Component):
    """Counts the items in flight, 0 … `most`: items that have come and not gone.

    A producer that ignores a queue's `ready` may send only while `room` is high, and pulses `goes`
    when an item leaves the queue. Every simulation and every proof stops (`hdl.lib.holds`) if the
    count would leave its range. An item may come and go in the same cycle; one that goes makes room
    for one that comes in that cycle.

    Parameters:
        most: maximum of the count
        items: name of the items, for the message of the assertion
        step: maximum number of items that come in one cycle
        begin: count after reset

    **Timing**: `count`, `room` and `any` show the cycles before. No combinational path. The
    flip-flops of `count`; no multiplier.
    """

    def __init__(self, most: int, items: str, *, step: int = 1, begin: int = 0):
        if not 1 <= step <= most:
            raise ValueError(f"{items}: step {step} is not in 1 … {most}")
        ports = {
            "comes": In(range(step + 1)),  # number of items that come in this cycle, 0 … `step`
            "goes": In(1),  # one item goes
            "count": Out(range(most + 1), init=begin),  # items in flight, 0 … `most`
            "room": Out(1),  # there is room for one more item
            "any": Out(1),  # the count is not 0
        }
        super().__init__(ports)
        self.most, self.step, self.items = most, step, items

    def elaborate(self, platform) -> Module:
        m = Module()
        count, comes, goes = self.count, self.comes, self.goes
        m.d.comb += [self.room.eq(count != self.most), self.any.eq(count.any())]
        then = count + comes - goes
        m.d.sync += count.eq(then)
        inside = (then >= 0) & (then <= self.most)
        holds(m, "count", inside, f"below 0 or above {self.most}: {self.items}")
        return m


class _Within(Elaboratable):
    """A `Credit` in simulations only."""

    def __init__(self, comes: Value, goes: Value, most: int, items: str, begin: int):
        self.comes, self.goes = comes, goes
        self.most, self.items, self.begin = most, items, begin

    def elaborate(self, platform) -> Module:
        m = Module()
        if platform is None:
            m.submodules.count = count = Credit(self.most, self.items, begin=self.begin)
            m.d.comb += [count.comes.eq(self.comes), count.goes.eq(self.goes)]
        return m


def within(m: Module, name: str, comes: Value, goes: Value, most: int, items: str, begin: int = 0):
    """Simulation-only check that the number in flight stays within 0 … `most`.

    comes, goes: number of items that come, and one bit: an item goes
    items: name of the items, for the message
    begin: number in flight after reset
    """
    m.submodules[f"within_{name}"] = _Within(comes, goes, most, items, begin)
