"""Placed and routed parts: real wires, their capacitance, a picture of the layout.

May import: spec, hdl, sim, eda, eda.cells.
"""
