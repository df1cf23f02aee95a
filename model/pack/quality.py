"""Names of the qualities in which a scene can be packed, and the default PSNR."""

SMALL, COMPACT = INDEXED = ("small", "compact")
"""Qualities of models in codebooks, degrees 0 and 1: half a beat per Gaussian, or one beat."""

STEPPED = ("balanced", "faithful")
"""Qualities of models in steps: at most two beats per Gaussian, or three."""

UNLEARNED = (COMPACT, *STEPPED)
"""Qualities for any scene; a small model is accurate only if the scene was fine-tuned for it."""

QUALITIES = (*INDEXED, *STEPPED)

LEAST_DB = 45.0
"""Minimum PSNR (dB) against the scene when no quality is requested, if any quality reaches it."""
