"""Binning: finds the tiles that each splat touches; writes its features and the groups' lists.

May import: spec, hdl.arithmetic, hdl.lib, hdl.memory.
"""
