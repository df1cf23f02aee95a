"""The result cache: its keys, failures that keep nothing, and the command `splatcore cache`."""

import os
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import sleep

import numpy as np
import pytest

from splatcore.sim.common.cache import kept_json
from splatcore.sim.rtl import build
from splatcore.sim.rtl.verilator import environment
from splatcore.spec.cache import cache_root, digest, kept_folder
from tb.helpers.command import check_documented, load, run


@dataclass(frozen=True)
class Facts:
    name: str
    values: np.ndarray


MADE_FROM = (
    "text", b"bytes", Path("path"), Facts("a", np.arange(3)), Facts("b", np.arange(3)),
    Facts("a", np.arange(4)), Facts("a", np.arange(3.0)), np.zeros((2, 3)), np.zeros((3, 2)),
    {"a": [1, np.float64(0.5)]}, {"a": [1, None]},
)  # fmt: skip


@pytest.fixture
def root(monkeypatch, tmp_path) -> Path:
    monkeypatch.setenv("SPLATCORE_CACHE", str(tmp_path))
    return tmp_path


def test_the_folder(monkeypatch, root):
    assert cache_root() == root
    monkeypatch.setenv("XDG_CACHE_HOME", str(root / "home"))
    monkeypatch.setenv("SPLATCORE_CACHE", "")
    empty = cache_root()
    monkeypatch.delenv("SPLATCORE_CACHE")
    for folder in (root, root / "home"):
        folder.mkdir(exist_ok=True)
        monkeypatch.chdir(folder)
        assert cache_root() == empty and empty.name == "splatcore"
    if sys.platform == "linux":
        assert empty == root / "home" / "splatcore"


def test_another_installation_shares_no_compiled_header(root, monkeypatch, tmp_path):
    """clang refuses a precompiled header if a file that it was made from is newer now."""
    file = tmp_path / "verilated.h"
    monkeypatch.setattr(build, "installed", lambda program, variables: [file])
    places = []
    for seconds in (1, 2, 1):
        file.touch()
        os.utime(file, (seconds, seconds))
        with build.shared(tmp_path / "obj", environment(), [], build.QUICK) as variables:
            places += re.findall(r"library-[0-9a-f]+", variables["MAKEFLAGS"])[:1]
    assert len(places) == 3 and places[0] == places[2] != places[1]


def test_the_command(root, capsys):
    """`cache` counts its own entries, and `cache --empty` removes them and no other file."""
    kept_json("synth", "a", lambda: "x" * 1000)
    kept_folder("streams", "a", lambda folder: (folder / "program").write_bytes(bytes(1 << 20)))
    (root / f"streams/library-{digest(1)}").mkdir()
    for other in ("letter.txt", "photos/1.jpg", "streams/notes.txt"):
        (root / other).parent.mkdir(exist_ok=True)
        (root / other).write_text("mine")
    assert run("cache", "--json", root / "c.json") == 0
    printed = capsys.readouterr().out
    found = load(root / "c.json")
    assert list(found["bytes"]) == ["streams", "synth"] and found["folder"] == str(root)
    assert found["bytes"]["streams"] == 1 << 20 and 1000 < found["bytes"]["synth"] < 1100
    assert str(root) in printed and "1.0" in printed and not found["emptied"]
    check_documented("## `splatcore cache`", found)
    assert run("cache", "--empty") == 0
    left = {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}
    assert left == {"c.json", "letter.txt", "photos/1.jpg", "streams/notes.txt"}
    assert not (root / "synth").exists()
    assert kept_json("synth", "a", lambda: "again") == "again"
    capsys.readouterr()


def test_no_cache_is_none(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("SPLATCORE_CACHE", str(tmp_path / "none"))
    assert run("cache") == 0 == run("cache", "--empty")
    assert "none" in capsys.readouterr().out and not (tmp_path / "none").exists()


def test_digests_differ():
    assert len({digest(value) for value in MADE_FROM}) == len(MADE_FROM)
    assert digest(Facts("a", np.arange(3))) == digest(MADE_FROM[3])
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    with pytest.raises(TypeError, match="has no hash"):
        digest(object())


def test_json_is_computed_once(root):
    asked = []

    def compute() -> dict:
        sleep(0.05)  # the other threads ask meanwhile
        return {"n": len(asked), "asked": asked.append(1)}

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: kept_json("kind", "a", compute), range(4)))
    assert found == [{"n": 0, "asked": None}] * 4
    assert kept_json("kind", "b", compute)["n"] == 1
    assert kept_json("other", "b", lambda: "other") == "other"
    assert len(asked) == 2 and len([*(root / "kind").glob("*.json")]) == 2


def test_a_failure_keeps_nothing(root):
    def fail(*folder: Path):
        for path in folder:
            (path / "half").touch()
        raise ValueError("no")

    with pytest.raises(ValueError):
        kept_json("kind", "a", fail)
    with pytest.raises(ValueError):
        kept_folder("kind", "a", fail)
    assert kept_json("kind", "a", lambda: 3) == 3
    folder = kept_folder("kind", "a", lambda folder: (folder / "whole").touch())
    assert kept_folder("kind", "a", fail) == folder and folder.parent == root / "kind"
    assert (folder / "whole").exists()
