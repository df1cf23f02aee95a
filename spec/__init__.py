"""Shared by golden model and hardware: conventions, number formats, records, sizes, memory layout.

`model`, `golden` and `hdl` import this package and it imports nothing but numpy and the
standard library. A width, an address or a threshold is written here once and nowhere else.
"""
