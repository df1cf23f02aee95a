"""Soak tests: thousands of random frames and faults against the golden model.

May import: spec, model, golden, sim.machine.
"""
