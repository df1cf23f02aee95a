"""Input for chip and FPGA tools, and their results: Verilog, gates, lint, placement, register map.

May import: spec, hdl, sim, eda, eda.gates.
"""
