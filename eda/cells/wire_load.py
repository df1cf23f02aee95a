"""Wires of nets within a part before a layout: capacitance by number of loads."""

import re

from splatcore.eda.cells.liberty import Library

WIRE_NET, WIRE_LOAD = -0.45, 0.60
"""Wire capacitance of a net within a part, in inputs of the smallest inverter: per net, and per
load. Least-squares fit of the nets of two routed parts by `splatcore synth --route`, an adder of
1,744 cells and the codebook with 2,351: docs/silicon.md."""

WIRE_MARGIN = 1.25
"""Factor of all wires: with it the longest paths of both parts take the time that OpenSTA finds
with routed wires, within 0.6 %. Their nets are longer than the mean, and have resistance."""

LOADS = 20
"""Numbers of loads in a library's table; it goes on in a straight line."""

WIRE_LOADS = """\
wire_load (fitted) {{
    area : 1;
    capacitance : {capacitance:.8f};
    resistance : 0;
    slope : {slope};
{lengths}
  }}
  default_wire_load : "fitted";
  """


def wire_capacitance(library: Library) -> tuple[float, float]:
    """Capacitance of a net's wires in pF: per net, and per load."""
    (inverter,) = library.inverter.inputs.values()
    unit = WIRE_MARGIN * sum(inverter) / 2
    return WIRE_NET * unit, WIRE_LOAD * unit


def with_wire_loads(library: Library) -> str:
    """The library's text with these wires as its wire loads, for sizing by ABC."""
    text = re.sub(r"default_wire_load\w* *:[^;]*;", "", library.text)
    lengths = "\n".join(
        f"    fanout_length ({n}, {WIRE_NET + n * WIRE_LOAD:.2f});" for n in range(1, LOADS + 1)
    )
    capacitance = wire_capacitance(library)[1] / WIRE_LOAD / library.capacitance
    added = WIRE_LOADS.format(capacitance=capacitance, slope=WIRE_LOAD, lengths=lengths)
    return re.sub(r"(?=\b(cell|wire_load) *\()", lambda _: added, text, count=1)
