"""Tests and testbenches, by the room they test."""
