"""Tests of the command line: commands run as a user runs them."""
