"""Power, first order, an estimate from switching in simulation.

May import: spec, hdl, sim.common, sim.cycles, sim.eda, sim.machine, sim.rtl.
"""
