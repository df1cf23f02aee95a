"""Views of a scene: a default view, orbits, and surrounding views.

May import: spec, model.formats.
"""
