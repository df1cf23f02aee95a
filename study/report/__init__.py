"""Report: one page of all results. A module has one large section or several similar ones.

May import: spec, model, sim, eda, study.accuracy, study.bench, study.results.
"""
