"""First-order power estimate from switching in RTL simulation.

May import: spec, golden, hdl, sim, eda, eda.cells, eda.gates.
"""
