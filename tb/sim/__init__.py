"""Tests of simulation, synthesis and measurement tools."""
