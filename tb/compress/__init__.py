"""Tests of training and compression; most need the extra [compress]."""
