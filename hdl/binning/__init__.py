"""From splats to the tiles they touch, the lists of tile groups and the features in memory.

May import: spec, hdl.arithmetic, hdl.lib, hdl.memory.
"""
