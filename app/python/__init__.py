"""The Python API of `import splatcore`: arrays in, arrays out, nothing printed.

May import: spec, model, golden, sim.
"""
