"""Rendering with gradients and fine-tuning. All but `drawn` needs the extra [compress] (PyTorch).

May import: spec, model.formats.
"""
