"""Stage 2: sorts each group's list of entries by depth, long ones from buckets in scratch memory.

May import: spec, hdl.lib.
"""
