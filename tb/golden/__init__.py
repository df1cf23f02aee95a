"""Tests of the reference and the golden model."""
