"""Shared definitions of the machine: sizes, number formats, records, memory, conventions.

`model`, `golden` and `hdl` import this package; it imports only numpy and the standard library.
Every width, address and threshold is defined here, and nowhere else.

Start with `config` (sizes), `memory` (the packed model), `registers` (the host's interface) and
`programs` (the arithmetic of stages 0 and 1).
"""
