"""Tests of `sim/view`: the page, its pictures, its camera."""
