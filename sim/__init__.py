"""Simulation, synthesis, measurements and the command line: code that runs the other packages.

May import: nothing.
"""
