"""Faults planted in the hardware's Python, and what judges whether tests catch them."""
