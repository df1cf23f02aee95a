"""The float64 reference renderer and the bit-accurate twin of each stage."""
