"""Datapaths without handshakes against their golden models, many in one simulation.

Compiling takes most of the time: one build has all of them, and each takes the lowest bits of the
same inputs.
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
    """A component that `enable` holds, and its golden model.

    golden: function of the codes [N] of the inputs that are named `given`; it returns those of the
    output, or a tuple if `read` names several. where: function of the same codes, the items that
    are compared (None: all).
    """

    component: wiring.Component
    latency: int
    given: tuple[str, ...]
    golden: Callable
    read: tuple[str, ...] = ("o",)
    where: Callable | None = None

    def codes(self, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        """The bits of the inputs that reach the component."""
        widths = [len(getattr(self.component, name)) for name in self.given]
        return [
            inputs[name].astype(np.int64) & (1 << width) - 1
            for name, width in zip(self.given, widths, strict=True)
        ]


class Together(wiring.Component):
    """Datapaths side by side; the outputs carry the datapath's number."""

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
    """Compare every bit. Inputs [N] go in one a cycle; without `enable` they leave no trace."""
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
        # Sample n shows what has moved before cycle n, and without registers cycle n itself.
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
    """Inputs [N] in that order with noise in between, and where they are: a fifth of the cycles
    pass without `enable`; at the end so many more that all come out."""
    count = len(next(iter(inputs.values())))
    enable = rng.random(5 * count // 4) < 0.8
    enable = np.append(enable, np.ones(max(0, count - enable.sum()) + extra, bool))
    place, paused = np.flatnonzero(enable)[:count], {}
    for name, codes in inputs.items():
        paused[name] = rng.integers(int(codes.min()), int(codes.max()) + 1, len(enable))
        paused[name][place] = codes
    return paused, enable
