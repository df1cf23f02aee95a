"""Static timing of a netlist of library cells: latest arrivals at all nets, longest paths.

The clock is ideal: it arrives everywhere at 0, without a slew. Clock-to-output and setup times of
flip-flops are the library's; times of memories and ports are those of `Assumed`. OpenSTA serves as
well but is not on PyPI: `tb/eda/test_silicon.py` compares the two where it is installed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatcore.eda.cells.cell_netlist import CellNetlist
from splatcore.eda.cells.delays import Arcs, fo4, propagate
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.wire_load import wire_capacitance
from splatcore.eda.cells.wires import WIRE_OHM, WIRE_PF, Repeater, lengths_between

MEMORY_ACCESS_FO4 = 16
"""From the clock to a memory's output in FO4, for all sizes. ASSUMED: 0.4 ns at 25 ps per FO4, like
a compiled memory of a few KB; a macro's data sheet has the real time."""

MEMORY_SETUP_FO4 = 4
"""Setup time of a memory's inputs in FO4. ASSUMED, like the access time."""


@dataclass(frozen=True)
class Assumed:
    """Assumed times in ns and capacitances in pF that are not in a library.

    fo4: unit of delay
    launch, slew: of input ports, like a flip-flop with a load of four inverters; by edge
    setup, load: of output ports, like a flip-flop's input
    access, memory_setup: of memories
    net_wire, load_wire: capacitance of a net's wires, per net and per load
    repeater: at the beginning of nets between parts; None without wires
    """

    fo4: float
    launch: np.ndarray
    slew: np.ndarray
    setup: float
    load: np.ndarray
    access: float
    memory_setup: float
    net_wire: float
    load_wire: float
    repeater: Repeater | None

    @classmethod
    def of(cls, library: Library, wires: bool = False) -> "Assumed":
        """Derive the assumptions from a library. wires: whether wires have a capacitance."""
        cell, arcs = library.flip_flop, Arcs([library.flip_flop])
        (inverter,) = library.inverter.inputs.values()
        launch = next(arc for arc in cell.arcs if arc.kind == "rising_edge")
        times = [arcs.delay(launch, edge, 0.0, 4 * inverter[edge]) for edge in range(2)]
        unit = fo4(library)
        net_wire, load_wire = wire_capacitance(library) if wires else (0.0, 0.0)
        setup = next(a for a in cell.arcs if a.kind == "setup_rising" and a.end == cell.data)
        return cls(
            fo4=unit,
            launch=np.array([time for time, _ in times]),
            slew=np.array([slew for _, slew in times]),
            setup=max(arcs.delay(setup, edge, 0.0, unit)[0] for edge in range(2)),
            load=np.array(cell.inputs[cell.data]),
            access=MEMORY_ACCESS_FO4 * unit,
            memory_setup=MEMORY_SETUP_FO4 * unit,
            net_wire=net_wire,
            load_wire=load_wire,
            repeater=Repeater.of(library, unit) if wires else None,
        )


@dataclass(frozen=True)
class Path:
    """A path between two edges of the clock.

    time: ns, setup included
    begin, end: kind (register, memory or port) and name
    steps: kind of cell, net that it drives, arrival in ns at that net, number of its loads; from
        the begin on
    """

    time: float
    begin: tuple[str, str]
    end: tuple[str, str]
    steps: tuple[tuple[str, str, float, int], ...]


class Timing:
    """Arrivals at all nets of a netlist, and its longest paths.

    registers_only: whether to ignore paths that begin or end at a port or a memory
    """

    def __init__(self, netlist: CellNetlist, assumed: Assumed, registers_only: bool = False):
        self.netlist, self.assumed, self.registers_only = netlist, assumed, registers_only
        self.library_arcs = Arcs(netlist.cell_kinds)
        self.lengths = lengths_between(netlist) * (assumed.repeater is not None)
        self.begins: dict[int, tuple[str, str]] = {}
        self.load, self.fanout = self._loads()
        self.far = self._repeated()
        self.arrival = np.full((netlist.nets, 2), -1.0)
        self.slew = np.zeros((netlist.nets, 2))
        if not registers_only:
            self._launch_others()
        self._launch_registers()
        self.arcs = self._sorted_arcs()
        first = np.searchsorted(self.arcs[:, 0], np.arange(netlist.nets + 1))
        waiting = np.bincount(self.arcs[:, 1], minlength=netlist.nets)
        each = self.library_arcs
        self.cause, self.origin, found = propagate(
            each.arrays, each.delays, each.slews, each.senses, first, self.arcs[:, 2].copy(),
            self.arcs[:, 1].copy(), waiting, self.load, self.lengths * WIRE_OHM / 1000, *self.far,
            self.arrival, self.slew,
        )  # fmt: skip
        if found < netlist.nets:
            raise ValueError(f"{netlist.nets - found} nets are in combinational loops")

    def _loads(self) -> tuple[np.ndarray, np.ndarray]:
        """Capacitance of each net in pF [nets, 2], rising and falling, and its number of loads."""
        netlist, assumed = self.netlist, self.assumed
        load, fanout = np.zeros((netlist.nets, 2)), np.zeros(netlist.nets, np.int64)

        def add(nets: np.ndarray, capacitance: np.ndarray | tuple[float, float]):
            np.add.at(load, nets, np.asarray(capacitance) + assumed.load_wire)
            np.add.at(fanout, nets, 1)

        for cell, _, nets in netlist.by_kind():
            for pin, capacitance in cell.inputs.items():
                if not (cell.is_clocked and pin == cell.clock):
                    add(nets[pin], capacitance)
        ends = [port for port in netlist.ports if not port.is_input]
        ends += [p for *_, ports in netlist.memories for p in ports if p.is_input]
        for port in ends:
            add(port.nets, assumed.load)
        load += assumed.net_wire * (fanout > 0)[:, None]
        return load, fanout

    def _repeated(self) -> tuple[np.ndarray, int]:
        """Give drivers of nets between parts the load of a repeater; return the repeaters' loads
        [nets, 2] and the number of their arc."""
        far, repeater = np.zeros((self.netlist.nets, 2)), self.assumed.repeater
        if repeater is None:
            return far, 0
        long = self.lengths > 0
        far[long] = self.load[long] + WIRE_PF * self.lengths[long, None]
        self.load[long] = repeater.load + self.assumed.net_wire + self.assumed.load_wire
        return far, self.library_arcs.number[id(repeater.arc)]

    def _arcs_of(self, *kinds: str) -> np.ndarray:
        """All arcs of these kinds [arcs, 4]: begin net, end net, number of the arc, cell."""
        found = [np.zeros((4, 0), np.int64)]
        for cell, cells, nets in self.netlist.by_kind():
            for arc in cell.arcs:
                logic = arc.begin in cell.inputs and not cell.is_clock_gate
                if arc.kind in kinds and (logic or arc.kind):
                    number = np.full(len(cells), self.library_arcs.number[id(arc)])
                    found.append(np.stack([nets[arc.begin], nets[arc.end], number, cells]))
        return np.concatenate(found, axis=1).T

    def _sorted_arcs(self) -> np.ndarray:
        """Arcs of logic, sorted by their begin nets; without arcs from or to constants."""
        arcs = self._arcs_of("")
        arcs = arcs[(arcs[:, 0] > 1) & (arcs[:, 1] > 1)]
        return arcs[np.argsort(arcs[:, 0], kind="stable")]

    def _launch_others(self):
        """Set arrivals at input ports and outputs of memories."""
        netlist, assumed = self.netlist, self.assumed
        for port in netlist.ports:
            if port.is_input and port.name != "clk":
                for bit, net in enumerate(port.nets):
                    self.arrival[net], self.slew[net] = assumed.launch, assumed.slew
                    self.begins[net] = "port", _bit(port.name, bit, port.nets)
        for path, _, ports in netlist.memories:
            for net in (net for port in ports if not port.is_input for net in port.nets):
                self.arrival[net], self.slew[net] = assumed.access, assumed.fo4
                self.begins[net] = "memory", path

    def _launch_registers(self):
        """Set arrivals at outputs of flip-flops."""
        arcs = self._arcs_of("rising_edge")
        self.launching = dict(zip(arcs[:, 1].tolist(), arcs[:, 3].tolist(), strict=True))
        for edge in range(2):
            load = self.load[arcs[:, 1], edge]
            times, slews = self.library_arcs.many(arcs[:, 2], edge, 0.0, load)
            np.maximum.at(self.arrival[:, edge], arcs[:, 1], times)
            np.maximum.at(self.slew[:, edge], arcs[:, 1], slews)

    @cached_property
    def ends(self) -> list[tuple[str, np.ndarray, np.ndarray, list[str]]]:
        """Ends of paths, by kind (register, memory, port): nets, setup times by edge, names."""
        netlist, assumed, found = self.netlist, self.assumed, []
        arcs = self._arcs_of("setup_rising")
        setup = [
            self.library_arcs.many(arcs[:, 2], edge, 0.0, self.slew[arcs[:, 1], edge])[0]
            for edge in range(2)
        ]
        names = [netlist.register(cell) for cell in arcs[:, 3]]
        found.append(("register", arcs[:, 1], np.stack(setup, 1), names))
        if self.registers_only:
            return found
        memory = [
            (net, path)
            for path, _, ports in netlist.memories
            for port in ports[1:] if port.is_input for net in port.nets
        ]  # fmt: skip
        port = [
            (net, _bit(port.name, bit, port.nets))
            for port in netlist.ports if not port.is_input for bit, net in enumerate(port.nets)
        ]  # fmt: skip
        for kind, ends, time in (
            ("memory", memory, assumed.memory_setup),
            ("port", port, assumed.setup),
        ):
            nets = np.array([net for net, _ in ends], np.int64)
            found.append((kind, nets, np.full((len(nets), 2), time), [name for _, name in ends]))
        return found

    def begin_of(self, net: int) -> tuple[str, str]:
        """Kind and name of the register, memory or port at which a path begins."""
        if (cell := self.launching.get(int(net))) is not None:
            return "register", self.netlist.register(cell)
        return self.begins.get(int(net), ("net", self.netlist.name(net)))

    def worst(self, longer: float = 0.0) -> Iterator[tuple[float, str, str, int, int]]:
        """Ends of paths longer than `longer` ns, longest first: time, kind, name, net, edge."""
        found = []
        for kind, nets, setup, names in self.ends:
            times = np.where(self.arrival[nets] >= 0, self.arrival[nets] + setup, -1.0)
            edges = times.argmax(axis=1)
            times = times.max(axis=1)
            for end in np.flatnonzero(times > longer):
                found.append((float(times[end]), kind, names[end], int(nets[end]), int(edges[end])))
        return iter(sorted(found, reverse=True))

    def path(self, time: float, kind: str, name: str, net: int, edge: int) -> Path:
        """The longest path to an end found by `worst`."""
        steps = []
        netlist = self.netlist
        while True:
            arc, before = self.cause[net, edge]
            cell = netlist.cell_kinds[netlist.kinds[self.arcs[arc, 3]]].name if arc >= 0 else ""
            step = cell, netlist.name(net), float(self.arrival[net, edge]), int(self.fanout[net])
            steps.append(step)
            if arc < 0:
                break
            net, edge = int(self.arcs[arc, 0]), int(before)
        return Path(time, self.begin_of(net), (kind, name), tuple(reversed(steps)))

    @cached_property
    def longest(self) -> Path | None:
        """The longest path; None for a netlist without paths."""
        return next((self.path(*end) for end in self.worst()), None)


def _bit(name: str, bit: int, nets: np.ndarray) -> str:
    return f"{name}[{bit}]" if len(nets) > 1 else name
