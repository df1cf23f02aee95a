"""Functions in C++: what is passed to them, what they are compiled for, and without a compiler."""

import ctypes
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from splatcore.spec import native
from splatcore.spec.error import InputError

PAIR = np.dtype([("count", np.int64), ("value", np.float64)])

SOURCE = """
#include "made.hpp"
extern "C" int64_t weigh(int64_t items, const Pair *pairs, double *found) {
    int64_t total = 0;
    for (int64_t k = 0; k < items; k++) {
        total += pairs[k].count;
        found[k] = pairs[k].value * WEIGHTS[k] + ADDED;
    }
    return total;
}
"""


@pytest.fixture
def source(tmp_path, monkeypatch):
    monkeypatch.setenv("SPLATCORE_CACHE", str(tmp_path / "cache"))
    (tmp_path / "weigh.cpp").write_text(SOURCE)
    return tmp_path / "weigh.cpp"


def weigh(source, added: int = 1):
    library = native.Library(source, {"WEIGHTS": (2, -3), "ADDED": added}, {"Pair": PAIR})
    return library.function("weigh", int, PAIR, np.float64, result=int)


def test_arguments(source):
    """Other dtypes, and arrays with gaps, are refused instead of misread."""
    pairs, found = np.array([(5, 0.5), (-7, 2.0)], PAIR), np.zeros(2)
    assert weigh(source)(2, pairs, found) == -2 and found.tolist() == [2.0, -5.0]
    for wrong in (found.astype(np.float32), np.zeros(4)[::2], np.zeros(2, np.int64)):
        with pytest.raises(ctypes.ArgumentError):
            weigh(source)(2, pairs, wrong)


def test_threads(source):
    """The first calls of a function may come from several threads at once."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(20):
            function = weigh(source)
            with ThreadPoolExecutor(8) as threads:
                pairs, found = np.zeros(1, PAIR), np.zeros(1)
                assert sum(threads.map(lambda _: function(1, pairs, found), range(64))) == 0  # noqa: B023
    finally:
        sys.setswitchinterval(interval)


def test_base(source):
    """A library has the functions, constants and structs of another one before its own."""
    base = native.Library(source, {"WEIGHTS": (2, -3), "ADDED": 1}, {"Pair": PAIR})
    more = source.with_name("more.cpp")
    more.write_text(
        'extern "C" int64_t more(const Pair *p, double *f) { return LEAST + weigh(2, p, f); }'
    )
    function = native.Library(more, {"LEAST": 40}, {}, base).function(
        "more", PAIR, np.float64, result=int
    )
    assert function(np.array([(5, 0.5), (-7, 2.0)], PAIR), np.zeros(2)) == 38


def test_kept(source, monkeypatch, tmp_path):
    """A library is compiled once per text, constants and processor, never for another's."""

    def made() -> int:
        return len(list((tmp_path / "cache" / "native").iterdir()))

    counts = []
    for change in (lambda: None, lambda: source.write_text(SOURCE + "//"), lambda: None):
        change()
        weigh(source)(0, np.zeros(0, PAIR), np.zeros(0))
        counts.append(made())
    monkeypatch.setattr(native, "processor", lambda: "another")
    weigh(source)(0, np.zeros(0, PAIR), np.zeros(0))
    assert [*counts, made()] == [1, 2, 2, 3]


def test_no_compiler(source, monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    with pytest.raises(InputError, match="no-such-compiler: is missing"):
        weigh(source)(0, np.zeros(0, PAIR), np.zeros(0))


def test_errors_of_the_compiler_are_shown(source):
    source.write_text("mistake")
    with pytest.raises(RuntimeError, match="mistake"):
        weigh(source)(0, np.zeros(0, PAIR), np.zeros(0))
