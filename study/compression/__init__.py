"""Benchmark of compression: size against loss after each step.

May import: spec, model, golden, sim, eda, study.bench, study.results.
"""
