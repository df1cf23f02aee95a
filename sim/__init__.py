"""Everything that runs the others: simulation, synthesis, measurements, the command line.

May import: nothing.
"""
