"""Faults planted in Verilog, to see whether tests notice them.

May import: sim.rtl.
"""
