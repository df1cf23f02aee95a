"""The cycle model: cycles of each stage and of a frame without the RTL.

May import: spec, golden, hdl, sim.machine.
"""
