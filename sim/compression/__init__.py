"""Benchmark of compression: size against loss, step by step.

May import: spec, model, golden, sim.bench, sim.common, sim.cycles, sim.eda, sim.machine, sim.power.
"""
