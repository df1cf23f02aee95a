"""Scenes of formats that are not read: one line names the format and a way to convert it."""

import pytest

from splatcore.model.formats.read import OTHERS, read_scene
from tb.helpers.scene_file import check_bad_scene, check_refused, read_written, splat_bytes

LINES = {
    "meta.lcc": "an LCC scene of XGRIDS, which is not read; convert it: splat-transform meta.lcc ",
    "meta.LCC2": "is an LCC 2 scene of XGRIDS, which is not read; convert it: splat-transform ",
    "a.spx": "is an SPX scene of Reall3D, which is not read; convert it: gsbox -i a.spx",
    "a.ssproj": "is a project of SuperSplat, which is not read; convert it: open it there and",
    "a.psht": "is a project of Postshot",
    "a.ckpt": "is a checkpoint of nerfstudio, which is not read; convert it: ns-export",
    "tileset.json": "is a 3D Tiles set, which is not read; convert it: open one of its .glb tiles",
    "a.mjs": "is a generator for splat-transform",
}


def test_all_are_known():
    assert all(any(name.lower().endswith(end) for name in LINES) for end in OTHERS)


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("start", [b"{}", b"PK\x03\x04 a zip archive"])
def test_line(tmp_path, name, start):
    check_bad_scene(tmp_path / name, start, LINES[name])


def test_folder(tmp_path):
    """A folder is known by a file in it."""
    (tmp_path / "data.bin").write_bytes(bytes(9))
    check_refused(read_scene, tmp_path, "is a directory without any of")
    (tmp_path / "meta.lcc").write_bytes(b"{}")
    check_refused(read_scene, tmp_path, "meta.lcc: is an LCC scene")


def test_the_whole_end_of_a_name_counts(tmp_path):
    """Extensions begin with a dot; JSON files of other names are none of these."""
    (tmp_path / "wellcc").write_bytes(b"{}")
    check_refused(read_scene, tmp_path / "wellcc", "is not a PLY")
    (tmp_path / "cameras.json").write_bytes(b"{}")
    check_refused(read_scene, tmp_path / "cameras.json", "is not a PLY")
    assert len(read_written(tmp_path / "tileset.json.splat", splat_bytes(2))) == 2
