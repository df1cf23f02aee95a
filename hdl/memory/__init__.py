"""The way to DRAM: AXI4 master, requests and data, bursts gathered and slots unpacked.

May import: spec, hdl.lib.
"""
