"""Floating-point units of any width, bit for bit those of `spec.number` and `spec.unary`.

May import: spec, hdl.lib.
"""
