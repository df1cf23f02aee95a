"""Tests of the whole machine: frames, faults, waveforms."""
