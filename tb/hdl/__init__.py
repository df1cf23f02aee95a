"""Tests of hardware, bit for bit against the golden model."""
