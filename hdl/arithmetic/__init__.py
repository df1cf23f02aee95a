"""Floating-point units of any width, bit for bit as in `spec.number` and `spec.unary`.

May import: spec, hdl.lib.
"""
