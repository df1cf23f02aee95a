"""Stage 2: sorts each group's list of entries by depth, long lists from buckets in scratch memory.

May import: spec, hdl.lib.
"""
