"""x

May import: nothing.
"""
