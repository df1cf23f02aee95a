"""Splatcore, an open accelerator for 3D Gaussian Splatting: golden model, hardware and tools.

The rooms of the repository are its packages: `splatcore.spec`, `model`, `golden`, `hdl` and `sim`.
"""
