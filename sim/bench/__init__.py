"""Benchmarks and campaigns over scenes and machines.

May import: spec, model, golden, hdl, sim.accuracy, sim.common, sim.cycles, sim.eda, sim.fit,
sim.machine, sim.packing, sim.rtl.
"""
