"""Rendering with gradients, and fine-tuning. Needs the extra [compress] (PyTorch), except `drawn`.

May import: spec, model.formats.
"""
