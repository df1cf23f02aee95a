"""Compare datapaths without handshakes with their golden models, many in one simulation.

Compiling takes most of the time, so all are in one build; each uses the lowest bits of the same
inputs.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.sim.rtl import vectors


@dataclass(frozen=True, eq=False)
class Datapath:
    """A component with `enable`, and its golden model.

    given: names of the inputs
    golden: function of the inputs' codes [N]; returns the output's codes, or a tuple for several
    read: names of the outputs
    where: function of the inputs' codes; returns which items are compared (None: all)
    """

    component: wiring.Component
    latency: int
    given: tuple[str, ...]
    golden: Callable
    read: tuple[str, ...] = ("o",)
    where: Callable | None = None

    def codes(self, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        """The inputs' codes, cut to the widths of the component's ports."""
        widths = [len(getattr(self.component, name)) for name in self.given]
        return [
            inputs[name].astype(np.int64) & (1 << width) - 1
            for name, width in zip(self.given, widths, strict=True)
        ]


class Together(wiring.Component):
    """Datapaths side by side; outputs are named with the datapath's number."""

    def __init__(self, datapaths: list[Datapath]):
        self.datapaths = datapaths
        self.widths = {"enable": 1}
        outputs = {}
        for number, datapath in enumerate(datapaths):
            for name in datapath.given:
                width = len(getattr(datapath.component, name))
                self.widths[name] = max(width, self.widths.get(name, 0))
            for name in datapath.read:
                outputs[f"{name}_{number}"] = Out(len(getattr(datapath.component, name)))
        super().__init__({name: In(width) for name, width in self.widths.items()} | outputs)

    def elaborate(self, platform) -> Module:
        m = Module()
        for number, datapath in enumerate(self.datapaths):
            m.submodules[f"part_{number}"] = part = datapath.component
            for name in ("enable", *datapath.given):
                m.d.comb += getattr(part, name).eq(getattr(self, name))
            for name in datapath.read:
                m.d.comb += getattr(self, f"{name}_{number}").eq(getattr(part, name))
        return m


def check(
    datapaths: list[Datapath], inputs: dict[str, np.ndarray], enable: np.ndarray | int = 1
) -> None:
    """Compare every bit. One input of [N] is applied per cycle, ignored without `enable`."""
    count = len(next(iter(inputs.values())))
    enable = np.broadcast_to(enable, count).astype(np.int64)
    together = Together(datapaths)
    driven = {
        name: codes.astype(np.int64) & (1 << together.widths[name]) - 1
        for name, codes in (inputs | {"enable": enable}).items()
    }
    samples = vectors.run(together, driven)
    moves, moved = np.flatnonzero(enable), np.cumsum(enable) - enable
    for number, datapath in enumerate(datapaths):
        # Sample n depends on moves before cycle n, and without registers on cycle n itself.
        known = np.flatnonzero(moved >= datapath.latency)
        source = moves[moved[known] - datapath.latency] if datapath.latency else known
        codes = datapath.codes(inputs)
        results = datapath.golden(*codes)
        if datapath.where:
            compared = datapath.where(*codes)[source]
            known, source = known[compared], source[compared]
        for name, expected in zip(
            datapath.read, results if len(datapath.read) > 1 else (results,), strict=True
        ):
            np.testing.assert_array_equal(
                samples[f"{name}_{number}"][known], expected[source],
                f"{type(datapath.component).__name__}: {datapath}, {name}",
            )  # fmt: skip


def with_pauses(
    inputs: dict[str, np.ndarray], rng: np.random.Generator, extra: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Insert cycles without `enable`, with noise as inputs, into inputs [N].

    extra: cycles with `enable` at the end, for the last outputs
    Returns the inputs and `enable`, low in a fifth of the cycles.
    """
    count = len(next(iter(inputs.values())))
    enable = rng.random(5 * count // 4) < 0.8
    enable = np.append(enable, np.ones(max(0, count - enable.sum()) + extra, bool))
    place, paused = np.flatnonzero(enable)[:count], {}
    for name, codes in inputs.items():
        paused[name] = rng.integers(int(codes.min()), int(codes.max()) + 1, len(enable))
        paused[name][place] = codes
    return paused, enable
