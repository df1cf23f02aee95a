"""Generated scenes: the garden, and the hard cases of tests and benchmarks.

May import: spec.
"""
