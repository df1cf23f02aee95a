"""Benchmark of compression: size against loss after each step.

May import: spec, model, golden, sim.bench, sim.common, sim.cycles, sim.eda, sim.machine, sim.power.
"""
