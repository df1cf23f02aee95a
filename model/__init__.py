"""Scene files and photographs in, the packed model for DRAM out.

May import: nothing.
"""
