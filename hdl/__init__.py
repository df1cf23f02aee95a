"""The accelerator in Amaranth, synthesizable: top module, frame control and host registers.

A Gaussian's way from memory to pixel: `points` reads it and makes a splat of it, `binning` lists
the splat for the tiles it touches, `sorting` brings lists into depth order, `raster` blends them.

May import: spec, hdl.arithmetic, hdl.binning, hdl.lib, hdl.memory, hdl.points, hdl.raster,
hdl.sorting.
"""
