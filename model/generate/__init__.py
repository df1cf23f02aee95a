"""Generated scenes: the garden, and the hard cases for tests and benchmarks.

May import: spec.
"""
