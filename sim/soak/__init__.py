"""Random frames and faults, thousands of them, against the golden model.

May import: spec, model, golden, sim.machine.
"""
