"""Stage 2: a group's entries in depth order, with runs in scratch memory for long lists.

May import: spec, hdl.lib, hdl.memory.
"""
