"""The application: command line, viewer, Python interface.

May import: nothing.
"""
