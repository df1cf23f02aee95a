"""Report: one page of all results. A module has one large section or several similar ones.

May import: spec, model, sim.accuracy, sim.bench, sim.common, sim.eda.
"""
