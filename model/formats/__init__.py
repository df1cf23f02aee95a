"""File formats: scenes, packed models, cameras, photographs with poses.

May import: spec.
"""
