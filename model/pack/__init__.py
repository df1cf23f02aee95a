"""Packing a scene: order in chunks, the factor L, codebooks, and the layout of `spec.memory`.

May import: spec.
"""
