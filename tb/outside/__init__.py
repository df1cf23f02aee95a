"""Renderings by an independent implementation, and the script that made them."""
