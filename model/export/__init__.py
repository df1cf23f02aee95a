"""Scenes and packed models as scene files for other tools, and the loss of each format.

May import: spec, model.formats, model.pack.
"""
