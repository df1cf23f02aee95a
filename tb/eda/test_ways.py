"""Choice of a mapping for each part of a machine, by the longest path of the whole."""

from types import SimpleNamespace

import pytest

from splatcore.eda.cells import ways as module
from splatcore.eda.cells.static_timing import Path
from splatcore.eda.cells.ways import ALONE_FO4, LONG_FO4, innermost, parts_of, settled

NETLISTS = {path: SimpleNamespace(text=path) for path in ("", "a", "a.b", "c")}

AREA = {"small": 1, "mid": 2, "large": 3}

WAYS = {2: ["small", "mid"], 3: ["large"]}


def path(fo4: float, begin: str, end: str) -> Path:
    return Path(fo4, ("register", begin), ("register", end), (("buf", "a.net", 1.0, 1),))


def settle(monkeypatch, path_of) -> tuple[dict, list]:
    """Run `settled` from all parts small; return its choice, and every combination it tried."""
    tried = []

    def together(library, pieces):
        tried.append(pieces)
        area = sum(AREA[piece] for piece in pieces.values())
        return SimpleNamespace(pieces=pieces, area=area)

    def timing(whole, assumed):
        return SimpleNamespace(longest=path_of(whole.pieces))

    monkeypatch.setattr(module, "put_together", together)
    monkeypatch.setattr(module, "Timing", timing)
    monkeypatch.setattr(module.Assumed, "of", lambda *_: SimpleNamespace(fo4=1.0))
    monkeypatch.setattr(module, "ways", lambda netlist, library, passes: WAYS[passes])
    _, pieces = settled(NETLISTS, dict.fromkeys(NETLISTS, "small"), None)
    return pieces, tried


def test_a_path_through_several_parts(monkeypatch):
    """Mappings of the part at the path's end are tried first; the smallest good one is kept."""
    depth = {"small": 47.0, "mid": 44.0, "large": 43.0}
    pieces, _ = settle(monkeypatch, lambda pieces: path(depth[pieces["a.b"]], "c.i", "a.b.o"))
    assert pieces == dict.fromkeys(NETLISTS, "small") | {"a.b": "mid"}


def test_another_part_on_the_way(monkeypatch):
    """If the end's mappings do not help, earlier parts are tried, then the next path."""
    first, second = {"small": 49, "mid": 50, "large": 44}, {"small": 46.0, "mid": 46.0, "large": 44}

    def longest(pieces):
        found = [path(first[pieces["c"]], "c.i", "a.b.o"), path(second[pieces["a"]], "c.i", "a.o")]
        return max(found, key=lambda each: each.time)

    pieces, _ = settle(monkeypatch, longest)
    assert pieces == {"": "small", "a": "large", "a.b": "small", "c": "large"}


@pytest.mark.parametrize("fo4, end", [(LONG_FO4, "a.o"), (60, "c.o")])
def test_nothing_to_try(monkeypatch, fo4, end):
    """Nothing is tried if no path is too long, or if the path stays within one part."""

    def longest(pieces):
        steps = () if end == "c.o" else (("buf", "a.net", 1.0, 1),)
        return Path(fo4, ("register", "c.i"), ("register", end), steps)

    pieces, tried = settle(monkeypatch, longest)
    assert set(pieces.values()) == {"small"} and len(tried) == 1


def test_where_a_path_leads():
    """Parts on a path by net names, from its end; nets of no part belong to the top."""
    steps = (("inv", "a.b.x[3]", 1.0, 1), ("inv", "net 7", 1.0, 1), ("inv", "a.bx", 1.0, 1))
    found = Path(1.0, ("memory", "c.table"), ("port", "done"), steps)
    assert list(parts_of(found, NETLISTS)) == ["", "a", "a.b", "c"]
    assert innermost("a.b.c.d", NETLISTS) == "a.b"
    assert ALONE_FO4 < LONG_FO4
