"""Placed and routed parts: real wires, their capacitance, a picture of the layout.

May import: spec, sim, hdl, eda, eda.cells, eda.gates.
"""
