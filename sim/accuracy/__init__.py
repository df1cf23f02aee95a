"""Error by number format: of points, depth keys and rasterizing.

May import: spec, model, golden, hdl, sim.common, sim.eda, sim.packing.
"""
