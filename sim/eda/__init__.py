"""For chip and FPGA tools and by them: Verilog, gates, lint, placement, register map.

May import: spec, hdl, sim.common, sim.rtl.
"""
