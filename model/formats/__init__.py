"""Files in and out: scenes of every format, packed models, cameras, photographs with poses.

May import: spec.
"""
