"""The whole machine in simulation, with memory and host, and the engines that render a frame.

May import: spec, model, golden, hdl, sim.common, sim.rtl.
"""
