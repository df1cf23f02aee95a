"""Stages 0 and 1: from the model in memory to splats; the first half of a frame.

May import: spec, hdl.arithmetic, hdl.binning, hdl.lib, hdl.memory.
"""
