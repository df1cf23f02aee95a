"""Parts that all tools share: scene arguments, output files, metrics, pictures, plots, pools.

May import: spec, model, golden.
"""
