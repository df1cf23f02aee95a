"""Tests of the viewer, `sim/view`: its page, pictures and camera."""
