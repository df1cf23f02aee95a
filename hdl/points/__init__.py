"""Stages 0 and 1: reads a model's Gaussians from memory, culls them and projects them to splats.

The arithmetic runs on processing elements (PEs), in an `array` per microprogram.

`preprocess` is the first half of a frame: stages 0 and 1 and binning, with their memory access.

May import: spec, hdl.arithmetic, hdl.binning, hdl.lib, hdl.memory.
"""
