"""Chip and FPGA design: delivered Verilog, gates, cells, timing, power, boards.

May import: sim.
"""
