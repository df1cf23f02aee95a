"""Amaranth modules: the machine, synthesizable. The top, control and registers; stages by room.

May import: spec, hdl.arithmetic, hdl.binning, hdl.lib, hdl.memory, hdl.points, hdl.raster,
hdl.sorting.
"""
