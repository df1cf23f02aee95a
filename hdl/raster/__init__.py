"""Stage 3: blends sorted splats into tiles, and writes the image to memory.

`render` is the second half of a frame: stages 2 and 3 with their memory access.

May import: spec, hdl.lib, hdl.memory, hdl.sorting.
"""
