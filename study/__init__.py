"""Studies over scenes and machines, and the report of their results.

May import: nothing.
"""
