"""Tests of numbers, records, presets and microprograms."""
