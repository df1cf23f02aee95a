"""Access to DRAM: the AXI4 master, readers of address ranges, writers that gather bursts.

May import: spec, hdl.lib.
"""
