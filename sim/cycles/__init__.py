"""The cycle model: cycles of each stage and of a frame, without simulating the RTL.

May import: spec, golden, hdl, sim.machine.
"""
