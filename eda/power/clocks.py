"""Gated clocks: which registers of a part share a clock gate, and how often it is open.

Synthesis finds the enables (`eda.gates.synth.CLOCK_GATES`). How often each is high is measured in
RTL, at the registers behind it (`eda.power.loads`). A gate is as often open as the most often
loaded of its registers; registers that RTL does not know are clocked in every cycle.
"""

import json
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from splatcore.eda.gates.machine_gates import netlist, pieces
from splatcore.eda.gates.synth import CLOCK_GATE, UNMAPPED, with_clock_gates
from splatcore.eda.power.activity import Register, register_name
from splatcore.spec.config import Config

CLOCKS = with_clock_gates(UNMAPPED).partition("dfflegalize")[0] + "write_json clocks.json\n"

WORD = re.compile(r"(.*)\[(\d+)\]$")  # a word of a memory of flip-flops


@dataclass(frozen=True)
class Clocked:
    """Clocks of a part.

    flip_flops, gated: number of flip-flops, and of those behind a clock gate
    gates: number of clock gates
    clocked: mean number of flip-flops that are clocked in a cycle
    """

    flip_flops: int
    gated: int
    gates: int
    clocked: float

    @property
    def share(self) -> float:
        """Share of the flip-flops that are clocked in a cycle."""
        return self.clocked / self.flip_flops if self.flip_flops else 1.0


@cache
def clock_groups(config: Config) -> list[tuple[str, str, list]]:
    """Flip-flops of each piece of the machine by their clock: part, path, `_groups`."""
    return [
        (part.name, path, piece.run(CLOCKS, lambda files: _groups(files["clocks.json"])))
        for part, path, piece in pieces(netlist(config))
    ]


def clocked(config: Config, registers: Mapping[str, Register]) -> dict[str, Clocked]:
    """Clocks of each part. registers: measured, by path and name"""
    found: dict[str, Clocked] = {}
    for name, path, groups in clock_groups(config):
        own = _clocked(groups, _Loads(registers, f"{path}." if path else "", groups))
        known = vars(found.get(name, Clocked(0, 0, 0, 0.0)))
        found[name] = Clocked(*(a + b for a, b in zip(known.values(), own, strict=True)))
    return found


def _clocked(groups: list[list[list]], loads: "_Loads") -> tuple[int, int, int, float]:
    """Fields of `Clocked` for a piece."""
    free, *gated = groups
    behind = sum(map(len, gated))
    mean = len(free) + sum(len(group) * max(map(loads.of, group)) for group in gated)
    return len(free) + behind, behind, len(gated), mean


def _groups(text: str) -> list[list[list]]:
    """Names of flip-flops, as (name, bit): first of those without a gate, then by gate."""
    top = json.loads(text)["modules"]["top"]
    names: dict[int | str, list] = defaultdict(list)
    for name, net in top["netnames"].items():
        if not net["hide_name"]:
            for k, bit in enumerate(net["bits"]):
                names[bit].append((name, k))
    groups: dict[int | str, list] = {"free": []}
    cells = top["cells"].values()
    groups |= {c["connections"]["GCLK"][0]: [] for c in cells if c["type"] == CLOCK_GATE}
    for cell in cells:
        if "DFF" in cell["type"]:
            nets = cell["connections"]
            groups.get(nets["C"][0], groups["free"]).append(names[nets["Q"][0]])
    return list(groups.values())


class _Loads:
    """How often the registers of a piece load."""

    def __init__(self, registers: Mapping[str, Register], path: str, groups: list[list[list]]):
        self.registers, self.path = registers, path
        self.words: dict[str, int] = defaultdict(int)  # of memories
        for names in (names for group in groups for names in group):
            for name, _ in names:
                if word := WORD.match(name):
                    self.words[word[1]] = max(self.words[word[1]], int(word[2]) + 1)

    def of(self, names: list) -> float:
        """Share of cycles in which a flip-flop loads; a word of a memory has its part of writes."""
        for name, bit in names:
            found = self.registers.get(register_name(self.path + name))
            if found is not None:
                return found.loads[bit if len(found.loads) > 1 else 0]
            if (word := WORD.match(name)) and (
                found := self.registers.get(register_name(self.path + word[1]))
            ):
                return found.loads[0] / self.words[word[1]]
        return 1.0
