"""What chip and FPGA tools need or tell: Verilog, gates, lint, placement, register map.

May import: spec, hdl, sim.common, sim.rtl.
"""
