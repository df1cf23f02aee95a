"""Packing to a wanted error: which model a scene becomes, and where its error comes from.

May import: spec, model, golden, sim.common.
"""
