"""Simulation: the RTL, the whole machine, the cycle model, and frames by any engine.

May import: nothing.
"""
