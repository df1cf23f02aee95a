"""Packing to a requested error: choice of the model, and its error by part.

May import: spec, model, golden, sim.common.
"""
