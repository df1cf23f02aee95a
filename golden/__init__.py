"""The float64 reference renderer, and the golden model: each stage in the machine's own integers.

May import: spec.
"""
