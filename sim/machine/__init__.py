"""The whole machine in simulation, with memory and host around it, and the engines of a frame.

May import: spec, model, golden, hdl, sim.common, sim.packing, sim.rtl.
"""
