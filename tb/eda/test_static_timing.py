"""Static timing: a few cells against sums computed here; slow paths by parts. Choice of a mapping
for each part of a machine, by the longest path of the whole."""

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

from splatcore.eda.cells import ways as module
from splatcore.eda.cells.cell_netlist import CONSTANTS, CellNetlist, put_together
from splatcore.eda.cells.delays import fo4
from splatcore.eda.cells.liberty_file import parse, read_liberty
from splatcore.eda.cells.mapping import EFFORTS, Mapped
from splatcore.eda.cells.silicon import Silicon, long_paths, part_at
from splatcore.eda.cells.static_timing import (
    MEMORY_ACCESS_FO4,
    MEMORY_SETUP_FO4,
    Assumed,
    Path,
    Timing,
)
from splatcore.eda.cells.ways import ALONE, LONG_FO4, WHOLE, innermost, parts_of, settled
from splatcore.eda.cells.wire_load import LOADS, WIRE_LOAD, WIRE_MARGIN, WIRE_NET, with_wire_loads
from splatcore.eda.cells.wires import SIDE_SHARE, WIRE_OHM, WIRE_PF, lengths_between
from tb.helpers.liberty import (
    AREA_FF,
    DATA,
    GATES,
    INPUT,
    LAUNCH,
    SETUP,
    SIZES,
    delay,
    small_library,
    transition,
)

MEMORY = "splatcore_memory_4x1"


def small_netlist(memory: bool = False) -> Mapped:
    """A flip-flop or memory (net 2), a NAND2 with a port, an inverter, two flip-flops."""
    cells = [
        ("NAND2_1", "n", [2, 3, 4]), ("INV_1", "i", [4, 5]),
        ("DFF_1", "b", [9, 5, 6]), ("DFF_1", "c", [9, 4, 7])
    ]  # fmt: skip
    blocks = []
    if memory:
        blocks = [(MEMORY, "m", [[9], [6], [6, 7], [5], [6], [6, 7], [2]])]
    else:
        cells.append(("DFF_1", "a", [9, 6, 2]))
    ports = [("clk", "input", [9]), ("i", "input", [3]), ("o", "output", [7])]
    return Mapped(cells, blocks, ports, {"2": "a", "6": "b", "7": "c"})


def through_two_gates(begin: float, slew: float, net: float = 0.0, wire: float = 0.0):
    """End time in ns of a path through the gates of `small_netlist`, from its arrival and slew."""
    middle, end = INPUT + DATA + net + 2 * wire, DATA + net + wire
    time = begin + delay(slew, middle, 1.2)
    return time + delay(transition(middle), end) + SETUP


@pytest.mark.parametrize("wires", [False, True])
def test_path_time(library, wires):
    """Path time is clock to output, gate delays by load and slew, and setup."""
    netlist = put_together(library, {"": small_netlist()})
    assumed = Assumed.of(library, wires)
    net, wire = (WIRE_MARGIN * each * INPUT * wires for each in (WIRE_NET, WIRE_LOAD))
    load = 1.2 * INPUT + net + wire
    time = through_two_gates(delay(0, load, first=LAUNCH), transition(load), net, wire)
    found = Timing(netlist, assumed, registers_only=True).longest
    assert found.time == pytest.approx(time)
    assert (found.begin, found.end) == (("register", "a"), ("register", "b"))
    assert [step[0] for step in found.steps] == ["", "NAND2_1", "INV_1"]
    assert [step[3] for step in found.steps] == [1, 2, 1]
    assert netlist.area == GATES["NAND2"][2] + GATES["INV"][2] + 3 * AREA_FF

    begin = delay(0, 4 * INPUT, first=LAUNCH)  # a port acts as a flip-flop driving four inverters
    time = through_two_gates(begin, transition(4 * INPUT), net, wire)
    longest = Timing(netlist, assumed).longest
    assert longest.time == pytest.approx(time) and longest.begin == ("port", "i")


def test_path_times_of_memories(library):
    """A path from a memory starts with its access time; a path into one ends with its setup."""
    netlist = put_together(library, {"": small_netlist(memory=True)})
    unit = fo4(library)
    timing = Timing(netlist, Assumed.of(library))
    ends = {name: time for time, _, name, *_ in reversed(list(timing.worst()))}
    access, setup = MEMORY_ACCESS_FO4 * unit, MEMORY_SETUP_FO4 * unit
    assert unit > 0 and access > 5 * LAUNCH / 3
    load = INPUT + DATA
    stage = through_two_gates(access, unit) - SETUP  # the inverter also drives a memory
    assert ends["b"] == pytest.approx(stage + 5 * DATA + SETUP)
    assert ends["m"] == pytest.approx(stage + 5 * DATA + setup)
    assert timing.longest.begin == ("memory", "m") and load


def test_wire_loads_for_sizing(library):
    """ABC sizes cells with the wires of static timing, in the unit of the library's file."""
    text = with_wire_loads(replace(library, capacitance=0.001))
    top = parse(text)
    (found,) = top.of_kind("wire_load")
    assert top.lines["default_wire_load"] == found.names[0]
    assumed, unit = Assumed.of(library, True), found.number("capacitance") / 1000
    lengths = re.findall(r"fanout_length \((\d+), ([\d.]+)\)", text)
    assert len(lengths) == LOADS
    for n, length in lengths:
        wires = assumed.net_wire + int(n) * assumed.load_wire
        assert float(length) * unit == pytest.approx(wires)


def in_two_parts(library) -> CellNetlist:
    """The small netlist with its second cell in a part of its own."""
    flat = small_netlist()
    inner = Mapped(
        [flat.cells[1]], [], [("a", "input", [4]), ("y", "output", [5])], {"5": "inverted"}
    )
    around = ("block", "part$3", [[4], [5]])
    outer = Mapped([flat.cells[0], *flat.cells[2:]], [around], flat.ports, flat.names)
    return put_together(library, {"": outer, "part": inner})


def test_pieces_are_timed_as_one(library):
    """A path through a separate block has the same time as in one flat netlist."""
    flat = small_netlist()
    whole = put_together(library, {"": flat})
    parts = in_two_parts(library)
    assert parts.area == whole.area and len(parts.kinds) == len(whole.kinds)
    times = [Timing(netlist, Assumed.of(library)).longest.time for netlist in (whole, parts)]
    assert times[0] == pytest.approx(times[1])
    assert "part.inverted" in parts.names.values()


def test_a_net_between_parts(library):
    """With wires, a net to another part goes through a repeater and a long wire, once."""
    netlist = in_two_parts(library)
    assumed = Assumed.of(library, True)
    repeater, length = assumed.repeater, SIDE_SHARE * netlist.area**0.5
    assert sorted(lengths_between(netlist))[-3:] == pytest.approx([0, length, length])
    net, wire = WIRE_MARGIN * WIRE_NET * INPUT, WIRE_MARGIN * WIRE_LOAD * INPUT
    (size,) = (size for size in SIZES if library.cells[f"BUF_{size:g}"].arcs[0] is repeater.arc)

    def through(slew: float, loads: float, sinks: int) -> tuple[float, float]:
        """Delay of the repeater and the wire; slew."""
        far = loads + net + sinks * wire + WIRE_PF * length
        time = delay(slew, far, size=size) + WIRE_OHM / 1000 * length * far / 2
        return time, transition(far, size)

    near = size * INPUT + net + wire
    begin = 1.2 * INPUT + net + wire
    time = delay(0, begin, first=LAUNCH)
    time += delay(transition(begin), near, 1.2)
    first = through(transition(near), INPUT + DATA, 2)
    time += first[0] + delay(first[1], near)
    second = through(transition(near), DATA, 1)
    found = Timing(netlist, assumed, registers_only=True).longest
    assert found.time == pytest.approx(time + second[0] + SETUP)


def test_a_register_that_is_read_inverted(tmp_path):
    """A register read by its inverted output is named after its other output."""
    text = small_library()
    output = re.search(r"    pin \(Q\) \{.*?\n    \}\n", text, re.S)[0]
    inverted = output.replace("(Q)", "(QN)").replace('"IQ"', '"IQN"')
    (tmp_path / "a.lib").write_text(text.replace(output, output + inverted))
    library = read_liberty(tmp_path / "a.lib")
    cells = [("DFF_1", "x", [9, 4, 2, 3]), ("INV_1", "y", [3, 4])]
    netlist = Mapped(cells, [], [("clk", "input", [9])], {"2": "count[3]"})
    longest = Timing(put_together(library, {"": netlist}), Assumed.of(library)).longest
    assert longest.begin == longest.end == ("register", "count[3]")


def test_a_loop_is_refused(library):
    loop = Mapped([("INV_1", "x", [2, 3]), ("INV_1", "y", [3, 2])], [], [], {})
    with pytest.raises(ValueError, match="2 nets are in combinational loops"):
        Timing(put_together(library, {"": loop}), Assumed.of(library))


def test_constants_and_open_pins(library):
    """A constant starts no path; a constant port and an open pin are accepted."""
    cells = [("NAND2_1", "n", ["1", 2, 3]), ("INV_1", "i", ["x", 4])]
    ports = [("i", "input", [2]), ("o", "output", [3, "1"])]
    netlist = put_together(library, {"": Mapped(cells, [], ports, {})})
    assert Timing(netlist, Assumed.of(library)).longest.begin == ("port", "i")
    assert CONSTANTS["1"] == 1 and netlist.pins[0, 0] == 1


def test_parts_around():
    names = {
        ("register", "render.raster.rasterizer3.blend.sums[3]"): "blend",
        ("memory", "render.sort.runs.sorter0.part.first"): "sub_sorter",
        ("register", "frame.x"): "frame",
        ("register", "count"): "top, the rest",
        ("port", "m_axi__arvalid"): "port",
    }
    assert {end: part_at(end) for end in names} == names


def test_long_paths(library):
    """Rows of paths longer than a limit in FO4, by parts: number of ends, and the longest."""
    found = Silicon.of(put_together(library, {"": small_netlist(memory=True)}))
    assert long_paths(found.timing, LONG_FO4) == []
    (row,) = long_paths(found.timing, 10)
    assert row["from"] == "memory m" and row["ends"] == 3
    assert row["fo4"] == pytest.approx(found.facts["longest"]["fo4"], abs=0.06)


NETLISTS = {path: SimpleNamespace(text=path) for path in ("", "a", "a.b", "c")}

AREA = {"small": 1, "mid": 2, "large": 3}

WAYS = dict(zip(EFFORTS, (["small"], ["mid"], ["large"]), strict=True))


def path(fo4: float, begin: str, end: str) -> Path:
    return Path(fo4, ("register", begin), ("register", end), (("buf", "a.net", 1.0, 1),))


def settle(monkeypatch, path_of) -> tuple[dict, list]:
    """Run `settled` from all parts small; return its choice, and every combination it tried."""
    tried = []

    def together(library, pieces):
        tried.append(pieces)
        area = sum(AREA[piece] for piece in pieces.values())
        return SimpleNamespace(pieces=pieces, area=area)

    def timing(whole, assumed):
        return SimpleNamespace(longest=path_of(whole.pieces))

    monkeypatch.setattr(module, "put_together", together)
    monkeypatch.setattr(module, "Timing", timing)
    monkeypatch.setattr(module.Assumed, "of", lambda *_: SimpleNamespace(fo4=1.0))
    monkeypatch.setattr(module, "ways", lambda netlist, library, effort: WAYS[effort])
    _, pieces = settled(NETLISTS, dict.fromkeys(NETLISTS, "small"), None)
    return pieces, tried


def test_a_path_through_several_parts(monkeypatch):
    """Mappings of the part at the path's end are tried first; the smallest good one is kept."""
    depth = {"small": 47.0, "mid": 44.0, "large": 43.0}
    pieces, _ = settle(monkeypatch, lambda pieces: path(depth[pieces["a.b"]], "c.i", "a.b.o"))
    assert pieces == dict.fromkeys(NETLISTS, "small") | {"a.b": "mid"}


def test_another_part_on_the_way(monkeypatch):
    """If the end's mappings do not help, earlier parts are tried, then the next path."""
    first, second = {"small": 49, "mid": 50, "large": 44}, {"small": 46.0, "mid": 46.0, "large": 44}

    def longest(pieces):
        found = [path(first[pieces["c"]], "c.i", "a.b.o"), path(second[pieces["a"]], "c.i", "a.o")]
        return max(found, key=lambda each: each.time)

    pieces, _ = settle(monkeypatch, longest)
    assert pieces == {"": "small", "a": "large", "a.b": "small", "c": "large"}


@pytest.mark.parametrize("fo4, end", [(LONG_FO4, "a.o"), (60, "c.o")])
def test_nothing_to_try(monkeypatch, fo4, end):
    """Nothing is tried if no path is too long, or if the path stays within one part."""

    def longest(pieces):
        steps = () if end == "c.o" else (("buf", "a.net", 1.0, 1),)
        return Path(fo4, ("register", "c.i"), ("register", end), steps)

    pieces, tried = settle(monkeypatch, longest)
    assert set(pieces.values()) == {"small"} and len(tried) == 1


def test_where_a_path_leads():
    """Parts on a path by net names, from its end; nets of no part belong to the top."""
    steps = (("inv", "a.b.x[3]", 1.0, 1), ("inv", "net 7", 1.0, 1), ("inv", "a.bx", 1.0, 1))
    found = Path(1.0, ("memory", "c.table"), ("port", "done"), steps)
    assert list(parts_of(found, NETLISTS)) == ["", "a", "a.b", "c"]
    assert innermost("a.b.c.d", NETLISTS) == "a.b"
    assert all(alone < whole for alone, whole in zip(ALONE, WHOLE, strict=True))
