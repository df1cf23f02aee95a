"""The accelerator in Amaranth, synthesizable: top module, frame control and host registers.

The path of a Gaussian from memory to pixel: `points` reads it and projects it to a splat, `binning`
adds the splat to the lists of the tiles it touches, `sorting` sorts each list by depth, `raster`
blends the splats.

The constructor of a component lists its ports, each with its direction, shape and meaning; ports
that only some machines have come last. `Internal` in a docstring lists signals and parts that
proofs and tests read.

May import: spec, hdl.arithmetic, hdl.binning, hdl.lib, hdl.memory, hdl.points, hdl.raster,
hdl.sorting.
"""
