"""Compiled delay calculation by a library's tables, and the FO4 of a library.

The model is OpenSTA's: tables of slew and load with linear inter- and extrapolation; at each net
the latest arrival and the slowest slew, separately for rising and falling edges; an ideal clock
that arrives everywhere at 0, without a slew.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from splatcore.eda.cells.liberty import Arc, Cell, Library, Table

CHAIN = 20  # inverters, enough for the delays to settle

NONE = -1  # no table

SENSES = {"positive": 1, "negative": -1, "": 0}


class Tables:
    """Tables of a library as arrays, for compiled code; each table is stored once."""

    def __init__(self):
        self.found: list[Table] = []
        self.numbers: dict[int, int] = {}

    def number(self, table: Table | None) -> int:
        if table is None:
            return NONE
        if id(table) not in self.numbers:
            self.numbers[id(table)] = len(self.found)
            self.found.append(table)
        return self.numbers[id(table)]

    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Rows and columns of each table, its slews, loads and values, padded with 0."""
        sizes = np.array([table.values.shape for table in self.found], np.int64)
        rows, columns = sizes.max(axis=0)
        slews, loads = np.zeros((len(sizes), rows)), np.zeros((len(sizes), columns))
        values = np.zeros((len(sizes), rows, columns))
        for k, table in enumerate(self.found):
            slews[k, : sizes[k, 0]], loads[k, : sizes[k, 1]] = table.slews, table.loads
            values[k, : sizes[k, 0], : sizes[k, 1]] = table.values
        return sizes, slews, loads, values


@njit(cache=True)
def _segment(axis, size, value):
    """Index of the interval for a value, and the value's relative position in it; values outside
    of the axis extrapolate."""
    if size == 1:
        return 0, 0.0
    k = 0
    while k < size - 2 and axis[k + 1] < value:
        k += 1
    return k, (value - axis[k]) / (axis[k + 1] - axis[k])


@njit(cache=True)
def lookup(tables, number, slew, load):
    """Interpolate in a table."""
    sizes, slews, loads, values = tables
    rows, columns = sizes[number]
    i, s = _segment(slews[number], rows, slew)
    j, t = _segment(loads[number], columns, load)
    table = values[number]
    value = table[i, j] * (1 - s) * (1 - t)
    if rows > 1:
        value += table[i + 1, j] * s * (1 - t)
    if columns > 1:
        value += table[i, j + 1] * (1 - s) * t
    if rows > 1 and columns > 1:
        value += table[i + 1, j + 1] * s * t
    return value


@njit(cache=True)
def propagate(
    tables, delays, slew_tables, senses, first, arcs, ends, waiting, load, kiloohm, far, repeater,
    arrival, slew,
):  # fmt: skip
    """Propagate arrivals and slews from the given nets to all nets.

    arcs, ends: kind and end net of each arc; the arcs of net n are first[n] … first[n + 1] − 1
    waiting: number of arcs that end at each net
    kiloohm: of the wire of each net between parts; 0 for the others
    far: [nets, 2] load of those nets' repeaters, by edge
    repeater: arc of the repeaters
    arrival, slew: [nets, 2] by edge, updated in place
    Returns, for each net and edge, the arc and input edge of its latest arrival and the net where
    that path begins; and the number of nets reached.
    """
    nets = len(waiting)
    origin = np.empty((nets, 2), np.int64)
    origin[:, 0] = origin[:, 1] = np.arange(nets)
    cause = np.full((nets, 2, 2), -1, np.int64)
    queue = np.empty(nets, np.int64)
    found = 0
    for net in range(nets):
        if waiting[net] == 0:
            queue[found] = net
            found += 1
    done = 0
    while done < found:
        net = queue[done]
        done += 1
        for edge in range(2):
            if kiloohm[net] > 0 and arrival[net, edge] >= 0:
                away, before = far[net, edge], slew[net, edge]
                arrival[net, edge] += kiloohm[net] * away / 2
                arrival[net, edge] += lookup(tables, delays[repeater, edge], before, away)
                slew[net, edge] = lookup(tables, slew_tables[repeater, edge], before, away)
        for arc in range(first[net], first[net + 1]):
            kind, end = arcs[arc], ends[arc]
            for after in range(2):
                table = delays[kind, after]
                for before in range(2):
                    if table < 0 or arrival[net, before] < 0:
                        continue
                    if senses[kind] != 0 and (before == after) != (senses[kind] > 0):
                        continue
                    time = arrival[net, before] + lookup(
                        tables, table, slew[net, before], load[end, after]
                    )
                    if time > arrival[end, after]:
                        arrival[end, after] = time
                        cause[end, after] = arc, before
                        origin[end, after] = origin[net, before]
                    steep = lookup(
                        tables, slew_tables[kind, after], slew[net, before], load[end, after]
                    )
                    slew[end, after] = max(slew[end, after], steep)
            waiting[end] -= 1
            if waiting[end] == 0:
                queue[found] = end
                found += 1
    return cause, origin, found


class Arcs:
    """Timing arcs of cells by number, for compiled code."""

    def __init__(self, cells: Sequence[Cell]):
        self.tables = Tables()
        self.number: dict[int, int] = {}
        rows = []
        for arc in (arc for cell in cells for arc in cell.arcs):
            self.number[id(arc)] = len(rows)
            pairs = arc.delays, arc.slews
            rows.append([SENSES[arc.sense], *(self.tables.number(t) for p in pairs for t in p)])
        rows = np.array(rows, np.int64)
        self.senses = rows[:, 0].copy()
        self.delays, self.slews = rows[:, 1:3].copy(), rows[:, 3:5].copy()
        self.arrays = self.tables.arrays()

    def delay(self, arc: Arc, edge: int, slew: float, load: float) -> tuple[float, float]:
        """Delay and output slew of an arc in ns. edge: of its output, 0 rise, 1 fall."""
        number = self.number[id(arc)]
        pair = self.delays[number, edge], self.slews[number, edge]
        return tuple(lookup(self.arrays, table, slew, load) for table in pair)

    def many(self, arcs: np.ndarray, edge: int, slew: np.ndarray | float, load: np.ndarray):
        """Delays and slews of arcs, by number; both are -1 if an arc has no such edge."""
        slews = np.broadcast_to(slew, len(arcs)).astype(float)
        numbers = self.delays[arcs, edge], self.slews[arcs, edge]
        return tuple(_values(self.arrays, each, slews, load.astype(float)) for each in numbers)


def fo4(library: Library) -> float:
    """Delay in ns of the library's smallest inverter with a load of four of its kind.

    Mean of a rising and a falling edge in a long chain.
    """
    cell = library.inverter
    arcs = Arcs([cell])
    arc = next(arc for arc in cell.arcs if not arc.kind)
    (loads,) = cell.inputs.values()
    times, slew = [], 0.0
    for k in range(CHAIN):
        time, slew = arcs.delay(arc, k % 2, slew, 4 * loads[k % 2])
        times.append(time)
    return sum(times[-2:]) / 2


def looked_up(table: Table, slew: np.ndarray, load: np.ndarray) -> np.ndarray:
    """A table's values at slews and loads [N]."""
    tables = Tables()
    number = np.full(len(slew), tables.number(table))
    return _values(tables.arrays(), number, slew, load)


@njit(cache=True)
def _values(tables, numbers, slew, load):
    found = np.full(len(numbers), -1.0)
    for k in range(len(numbers)):
        if numbers[k] >= 0:
            found[k] = lookup(tables, numbers[k], slew[k], load[k])
    return found
