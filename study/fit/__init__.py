"""Search for the smallest machine for a scene, and preset files.

May import: spec, golden, hdl, sim, eda.
"""
