"""Gates and paths of each part and of the whole machine, by synthesis.

May import: spec, hdl, sim, eda.
"""
