"""One page of all results, a file for each section.

May import: spec, model, sim.bench, sim.common, sim.eda.
"""
