"""Planted faults: one change at a time in the Python source of `hdl`, which tests must catch."""
