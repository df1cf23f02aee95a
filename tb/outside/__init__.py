"""Renderings by an implementation that is not ours, and the script that made them."""
