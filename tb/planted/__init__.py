"""Faults planted in the Python source of `hdl`, one at a time, and whether the tests catch them."""
