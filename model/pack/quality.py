"""How a scene can be packed, by name, and what is good enough."""

SMALL, COMPACT = INDEXED = ("small", "compact")
"""Qualities of models in codebooks, of degree 0 and 1: half a beat a Gaussian, or one."""

STEPPED = ("balanced", "faithful")
"""Qualities of models in steps: at most two beats a Gaussian, or three."""

UNLEARNED = (COMPACT, *STEPPED)
"""Those for scenes as they are: a small model is far from one that has not learned its numbers."""

QUALITIES = (*INDEXED, *STEPPED)

LEAST_DB = 45.0
"""dB against the scene that a model has at least, if one has, where no quality is asked for."""
