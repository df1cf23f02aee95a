"""A placed and routed FPGA design of a part or of the whole machine.

May import: spec, hdl, sim, eda.gates.
"""
