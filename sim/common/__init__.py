"""What all tools share: scene arguments, output files, metrics, pictures, results, plots.

May import: spec, model.
"""
