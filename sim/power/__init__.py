"""First-order power estimate from switching in RTL simulation.

May import: spec, hdl, sim.common, sim.cycles, sim.eda, sim.machine, sim.rtl.
"""
