"""Methods with a fault planted in them, for proofs that must fail."""

import inspect
import textwrap
from collections.abc import Callable


def planted(method: Callable, old: str, new: str) -> Callable:
    """The method with one piece of its source replaced."""
    source = textwrap.dedent(inspect.getsource(method))
    assert source.count(old) == 1
    scope = dict(method.__globals__)
    exec(source.replace(old, new), scope)
    return scope[method.__name__]
