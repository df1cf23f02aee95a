"""Error by number format: of points, depth keys and rasterizing; and where all of it comes from.

May import: spec, model, golden, hdl, sim.common, sim.eda, sim.packing.
"""
