"""How a scene can be packed, by name, and what is good enough."""

QUALITIES = ("compact", "balanced", "faithful")
"""Codebooks of degree 0 and 1; steps, at most two beats a Gaussian, or three."""

STEPPED = QUALITIES[1:]
"""Qualities of models in steps, the smaller first."""

LEAST_DB = 45.0
"""dB against the scene that a model has at least, if one has, where no quality is asked for."""
