"""Inputs, machines and the command line, shared by several tests. No tests."""
