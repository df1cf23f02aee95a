"""Training and compression: pruning, distillation, quantisation. Needs the extra [compress].

May import: spec, model.cameras, model.formats, model.gradients, model.pack.
"""
