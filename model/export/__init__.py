"""Scenes and packed models as scene files for other tools, and the loss of each format.

May import: model.formats, model.pack, spec.
"""
