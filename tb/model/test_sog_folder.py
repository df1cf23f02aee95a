"""SOG scenes in folders: unbundled (meta.json) and streamed (lod-meta.json); malformed ones."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from splatcore.model.formats.read import read_scene
from splatcore.spec.scene import ARRAYS
from tb.helpers.refusal import refused
from tb.helpers.scene_file import (
    check_refused,
    edited,
    image_bytes,
    ply_bytes,
    ply_columns,
    sog_bytes,
    sog_codes,
    sog_meta,
)
from tb.helpers.scenes import random_scene

COUNT = 6


def unbundle(folder: Path, count: int = COUNT, degree: int = 1, version: int = 2, seed: int = 0):
    """Write an unbundled SOG of random Gaussians; return the same as a file of one archive."""
    folder.mkdir(parents=True, exist_ok=True)
    meta, codes = sog_meta(version, count, degree, seed), sog_codes(count, degree, 3, seed)
    (folder / "meta.json").write_text(json.dumps(meta))
    for name, pixels in codes.items():
        (folder / f"{name}.webp").write_bytes(image_bytes(pixels))
    return sog_bytes(meta, codes)


def check_equal(scene, other):
    for name in ARRAYS:
        assert np.array_equal(getattr(scene, name), getattr(other, name)), name


@pytest.mark.parametrize("version", [1, 2])
def test_unbundled(tmp_path, version):
    """meta.json, its folder, and a meta.json of another name hold the scene of the archive."""
    (tmp_path / "scene.sog").write_bytes(unbundle(tmp_path / "a", version=version))
    bundled = read_scene(tmp_path / "scene.sog")
    for path in ("a", "a/meta.json"):
        scene = read_scene(tmp_path / path)
        check_equal(scene, bundled)
        assert (scene.notes, scene.name) == (bundled.notes, str(tmp_path / "a/meta.json"))
    (tmp_path / "a/meta.json").rename(tmp_path / "a/scene.META.json")
    check_equal(read_scene(tmp_path / "a/scene.META.json"), bundled)


def test_training_folder_comes_first(tmp_path):
    unbundle(tmp_path)
    place = tmp_path / "point_cloud/iteration_7"
    place.mkdir(parents=True)
    columns = ply_columns(random_scene(3, 0))
    (place / "point_cloud.ply").write_bytes(ply_bytes({"vertex": columns}))
    assert len(read_scene(tmp_path)) == 3


BAD_META = {
    "is not valid JSON": "{",
    "version 3 is not supported": edited(sog_meta(2, COUNT, 1), "version", 3),
    "'means' is missing": edited(sog_meta(2, COUNT, 1), "means", None),
    "no none.webp in its folder": edited(sog_meta(2, COUNT, 1), "quats", "files", ["none.webp"]),
    "'../a/quats.webp' is not in its folder": edited(
        sog_meta(2, COUNT, 1), "quats", "files", ["../a/quats.webp"]
    ),
    "'/etc/passwd' is not in": edited(sog_meta(2, COUNT, 1), "quats", "files", ["/etc/passwd"]),
    "no a\0b in": edited(sog_meta(2, COUNT, 1), "quats", "files", ["a\0b"]),
    "in its folder": edited(sog_meta(2, COUNT, 1), "quats", "files", ["x" * 5000]),
    "is a directory": edited(sog_meta(2, COUNT, 1), "quats", "files", [""]),
    "is not a string": edited(sog_meta(2, COUNT, 1), "quats", "files", [3]),
    "7 Gaussians exceed": edited(sog_meta(2, COUNT, 1), "count", 7),
}


@pytest.mark.parametrize("message", BAD_META)
def test_bad_meta(tmp_path, message):
    unbundle(tmp_path / "a")
    value = BAD_META[message]
    text = value if isinstance(value, str) else json.dumps(value)
    (tmp_path / "a/meta.json").write_text(text)
    refused(message.replace("not a string", "3, not a string"), read_scene, tmp_path / "a")


@pytest.mark.parametrize(
    "message, data",
    [
        ("quats.webp: is empty", b""),
        ("quats.webp: is not a WebP or PNG image", b"RIFF"),
        ("quats.webp: claims 64000000 bytes", image_bytes(np.zeros((4000, 4000, 4), np.uint8))),
    ],
)
def test_bad_image(tmp_path, message, data):
    """Each message begins with the path of the file that is meant."""
    unbundle(tmp_path)
    (tmp_path / "quats.webp").write_bytes(data)
    check_refused(read_scene, tmp_path, message)


LEVELS = 2
FILES = ["0_0/meta.json", "0_1.sog", "1_0/meta.json"]
SIZES = (6, 5, 3)
TREE = {
    "children": [
        {"lods": {"0": {"file": 1, "offset": 0, "count": 2}}},
        {"children": [{"lods": {"0": {"file": 0, "offset": 2, "count": 4},
                                "1": {"file": 2, "offset": 0, "count": 3}}},
                      {"lods": {"0": {"file": 1, "offset": 2, "count": 3}}}]},
        {"lods": {"0": {"file": 0, "offset": 0, "count": 2}}},
    ]
}  # fmt: skip
META = {
    "version": 1, "counts": [11, 3], "lodLevels": LEVELS, "environment": "env/meta.json",
    "filenames": FILES, "tree": TREE,
}  # fmt: skip


def stream(folder: Path, meta: object = META):
    """Write a streamed SOG: two files of level 0, of degrees 1 and 2, one of level 1."""
    unbundle(folder / "0_0", SIZES[0], 1, seed=1)
    (folder / "0_1.sog").write_bytes(unbundle(folder / "spare", SIZES[1], 2, seed=2))
    shutil.rmtree(folder / "spare")
    unbundle(folder / "1_0", SIZES[2], 1, seed=3)
    unbundle(folder / "env", 4, 0, seed=4)
    text = meta if isinstance(meta, str) else json.dumps(meta)
    (folder / "lod-meta.json").write_text(text)


def test_streamed(tmp_path):
    """A level holds the parts of all leaves, in the order of the files, then the environment."""
    stream(tmp_path)
    units = [read_scene(tmp_path / name) for name in (*FILES, "env")]
    for lod, parts in ((None, (0, 1, 3)), (0, (0, 1, 3)), (1, (2, 3))):
        scene, start = read_scene(tmp_path, lod=lod), 0
        assert len(scene) == sum(len(units[k]) for k in parts)
        for unit in (units[k] for k in parts):
            some, start = scene[start:][: len(unit)], start + len(unit)
            held = unit.sh.shape[1]
            check_equal(some.with_sh_degree(unit.sh_degree), unit)
            assert not some.sh[:, held:].any()
        count = (11, 3)[lod or 0]
        assert scene.notes[:2] == (
            f"level of detail {lod or 0} of 0 … 1 (see --lod): {count} Gaussians",
            "environment of 4 Gaussians added",
        )
        ended = "leaves of which nothing is left at level 1: 3"
        assert (ended in scene.notes) == (lod == 1) and "nearest" not in str(scene.notes)
        check_equal(read_scene(tmp_path / "lod-meta.json", lod=lod), scene)
    refused(r"lod-meta.json: --lod 2: has levels 0 \(the finest\) … 1", read_scene, tmp_path, lod=2)


def test_leaves_without_the_level(tmp_path):
    """The next finer level stands for a missing or empty one, else the next coarser; a leaf ends
    with its coarsest level."""
    leaves = ({"0": 0, "1": 0, "2": 2}, {"3": 1}, {"0": 2}, {"0": 1, "1": 1, "2": 0, "4": 1})
    starts = [0] * len(FILES)

    def lods(leaf: dict) -> dict:
        """One Gaussian of the file for each level, the next one; file 0: none."""
        found = {}
        for level, unit in leaf.items():
            found[level] = {"file": unit, "offset": starts[unit], "count": int(unit > 0)}
            starts[unit] += unit > 0
        return {"lods": found}

    children = [lods(leaf) for leaf in leaves]
    meta = {"lodLevels": 5, "filenames": FILES, "tree": {"children": children}}
    stream(tmp_path, meta)
    one, two = (read_scene(tmp_path / name) for name in FILES[1:])
    for level, (wanted, other, ended) in {
        0: (([0, 1], [0, 1]), 2, 0),
        2: (([0, 2], [0]), 2, 1),
        3: (([0, 2], []), 1, 2),
        4: (([3], []), 0, 3),
    }.items():
        scene = read_scene(tmp_path, lod=level)
        position = np.concatenate([one.position[wanted[0]], two.position[wanted[1]]])
        assert np.array_equal(scene.position, position), level
        notes = (f"leaves without level {level}, read at the nearest one: {other}",)
        notes += (f"leaves of which nothing is left at level {level}: {ended}",)
        assert [note for note in notes if note in scene.notes] == [
            note for note, count in zip(notes, (other, ended), strict=True) if count
        ]
    del meta["tree"]["children"][3]["lods"]["0"]
    stream(tmp_path, meta | {"counts": [1, 0, 1, 1, 1]})
    assert len(read_scene(tmp_path)) == 4  # counts are of the level's own entries
    meta["tree"]["children"][1]["lods"]["3"]["file"] = 9
    stream(tmp_path, meta)
    refused("node 2: level 3: 'file' 9 is not among 3 files", read_scene, tmp_path)


def test_part_of_a_file(tmp_path):
    """Gaussians that no leaf takes are left out; fields of other versions may be missing."""
    tree = {"lods": {"0": {"file": 0, "offset": 1, "count": 3}}}
    stream(tmp_path, {"lodLevels": 1, "filenames": FILES, "tree": tree})
    check_equal(read_scene(tmp_path), read_scene(tmp_path / "0_0")[1:4])


def test_a_folder_of_both_is_streamed(tmp_path):
    unbundle(tmp_path)
    stream(tmp_path)
    assert len(read_scene(tmp_path)) == 15


def test_levels_of_other_scenes_are_refused(tmp_path):
    unbundle(tmp_path)
    message = "meta.json: --lod 0: only a streamed SOG has levels of detail"
    refused(message, read_scene, tmp_path, lod=0)


def _leaf(*keys: object) -> dict:
    """The file with one value of the leaf of both levels replaced."""
    return edited(META, "tree", "children", 1, "children", 0, "lods", *keys)


BAD = {
    "lod-meta.json: is not valid JSON": "{",
    "is not valid JSON": "[" * 100_000,
    "lod-meta.json: is \\[\\], not an object": [],
    "streamed SOG version 2": edited(META, "version", 2),
    "'lodLevels' is missing": edited(META, "lodLevels", None),
    "'lodLevels' is 0": edited(META, "lodLevels", 0),
    "'filenames': is 3, not a list": edited(META, "filenames", 3),
    "'filenames': is None, not a string": META | {"filenames": [None]},
    "'filenames': names a file twice": META | {"filenames": [*FILES, f"./{FILES[0]}"]},
    "no 9.sog in its folder": META | {"filenames": ["9.sog", *FILES[1:]]},
    "'../0.sog' is not in its folder": META | {"filenames": ["../0.sog", *FILES[1:]]},
    "0_1.sog: is not a zip archive": META | {"filenames": [FILES[0], "0_1.sog"]},
    "'tree' is missing": edited(META, "tree", None),
    "node 2: is 3, not an object": edited(META, "tree", "children", 1, 3),
    "node 0: 'children': is {}": edited(META, "tree", "children", {}),
    "node 3: 'lods': is \\[\\]": edited(META, "tree", "children", 1, "children", 0, "lods", []),
    "node 3: level 0: is 5, not an object": _leaf("0", 5),
    "node 3: level 0: 'count' is missing": _leaf("0", "count", None),
    "node 3: level 0: 'file' 3 is not among 3": _leaf("0", "file", 3),
    "node 3: level 0: 'file' -1": _leaf("0", "file", -1),
    "'offset' -1 or 'count' 4 is negative": _leaf("0", "offset", -1),
    "level 0: leaves overlap in file 0": _leaf("0", "offset", 1),
    "level 0: leaves hold 9 Gaussians, 'counts' differs": _leaf("0", "count", 2),
    "hold 11 Gaussians, 'counts' differs": edited(META, "counts", []),
    "0_0/meta.json: has 6 Gaussians, lod-meta.json takes 2 … 1000000": edited(
        _leaf("0", "count", 10**6 - 2), "counts", None
    ),
    "'environment': is 3": edited(META, "environment", 3),
    "no none in its folder": edited(META, "environment", "none"),
    "holds 0 Gaussians": {"lodLevels": 1, "filenames": [], "tree": {}},
}


@pytest.mark.parametrize("message", BAD)
def test_bad_stream(tmp_path, message):
    stream(tmp_path, BAD[message])
    if "0_1.sog" in message:
        (tmp_path / "0_1.sog").write_bytes(b"no zip")
    refused(message, read_scene, tmp_path)


def test_many_levels_and_leaves_take_no_time(tmp_path):
    """Numbers in the file that nothing else bounds: levels, and leaves without Gaussians."""
    leaves = [{"lods": {"0": {"file": 0, "offset": 0, "count": 0}}}] * 20_000
    tree = {"children": [*leaves, {"lods": {"0": {"file": 0, "offset": 0, "count": 6}}}]}
    stream(tmp_path, {"lodLevels": 2**62, "filenames": FILES, "tree": tree})
    assert len(read_scene(tmp_path)) == 6
