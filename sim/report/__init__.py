"""One page of all results, a file for a large section or for some that are alike.

May import: spec, model, sim.accuracy, sim.bench, sim.common, sim.eda.
"""
