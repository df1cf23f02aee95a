"""What `import splatcore` gives to Python programs: arrays in, arrays out, nothing printed.

May import: spec, model, golden, sim.common, sim.cycles, sim.packing.
"""
