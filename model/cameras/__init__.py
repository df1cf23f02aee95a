"""Views of a scene: a sensible one, orbits, and views that surround it.

May import: spec, model.formats.
"""
