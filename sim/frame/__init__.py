"""A frame: scene, camera and packed model in; engines that render it; comparison of pictures.

May import: spec, model, golden, sim.common, sim.machine.
"""
