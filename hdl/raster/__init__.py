"""Stage 3 and the second half of a frame: from sorted lists to pixels in memory.

May import: spec, hdl.lib, hdl.memory, hdl.points, hdl.sorting.
"""
