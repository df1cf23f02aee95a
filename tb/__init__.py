"""Tests and testbenches, in folders named like the rooms they test."""
