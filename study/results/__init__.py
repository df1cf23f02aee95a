"""Results: dataclasses whose fields say what each value means, and what follows from them.

May import: spec, sim.
"""
