"""The viewer: a page in the browser with the golden machine's picture of where its camera rests.

May import: spec, model, golden, sim.common, sim.cycles, sim.machine, sim.packing.
"""
