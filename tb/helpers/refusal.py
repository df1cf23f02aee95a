"""Checks that calls refuse their input."""

from collections.abc import Callable

import pytest

from splatcore.spec.error import InputError


def refused(message: str, call: Callable, *given, **options):
    """Check that a call raises InputError with a message in which the pattern `message` occurs."""
    with pytest.raises(InputError, match=message):
        call(*given, **options)
