"""Benchmarks and campaigns over scenes and machines.

May import: spec, model, golden, hdl, sim, eda, study.accuracy, study.fit, study.results.
"""
