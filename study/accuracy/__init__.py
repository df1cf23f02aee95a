"""Error by number format: of points, depth keys and rasterizing; and the error budget of a picture.

May import: spec, model, golden, hdl, sim, eda, study.results.
"""
