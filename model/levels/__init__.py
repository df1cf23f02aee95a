"""Levels of detail: coarser chunks merged from a packed model's, and the model with both.

May import: spec, model.compress, model.export, model.pack.
"""
