"""The viewer: a page in the browser with the golden model's picture once the camera rests.

May import: spec, model, golden, sim.
"""
