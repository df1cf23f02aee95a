"""From a scene file or photographs to the packed model in DRAM.

May import: nothing.
"""
