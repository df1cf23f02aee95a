"""Tests of scene files, cameras, generated scenes and packing."""
