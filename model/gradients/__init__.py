"""Rendering with gradients and fine-tuning. Needs the extra [compress] (PyTorch).

May import: spec, model.formats.
"""
