"""Tests of number formats, records, presets and microprograms."""
