"""Code that all tools share: scene arguments, output files, metrics, pictures, plots, processes.

May import: spec.
"""
