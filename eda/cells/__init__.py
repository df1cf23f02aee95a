"""Standard cells: libraries, mapping to them, and the timing and energy of netlists.

May import: spec, hdl, sim, eda, eda.deliver, eda.gates.
"""
