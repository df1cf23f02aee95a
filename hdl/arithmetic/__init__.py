"""Floating-point units of any width, bit for bit as `spec.number` and `spec.unary` say.

May import: spec, hdl.lib.
"""
