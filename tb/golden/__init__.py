"""Tests of the float64 reference and the golden model."""
