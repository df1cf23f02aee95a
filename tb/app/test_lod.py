"""`--lod` and scenes in folders and of formats without a mark, as commands open them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import splatcore
from splatcore.sim.frame.picture import read_png
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.source import camera_beside, opened, scene_files
from splatcore.spec.error import InputError
from tb.helpers.command import check_refused, load, run
from tb.helpers.ksplat_file import small_ksplat
from tb.helpers.scene_file import image_bytes, sog_bytes, sog_codes, sog_meta


@pytest.fixture
def place(folder):
    """A streamed SOG of two levels, `streamed`; the finer one as a file, fine.sog, and unbundled,
    `fine`."""
    tree = {"lods": {str(k): {"file": k, "offset": 0, "count": 60 - 20 * k} for k in range(2)}}
    meta = {"version": 1, "lodLevels": 2, "filenames": ["0.sog", "1.sog"], "tree": tree}
    for name in ("streamed", "fine"):
        Path(name).mkdir()
    Path("streamed/lod-meta.json").write_text(json.dumps(meta))
    for k in range(2):
        stored = sog_meta(2, 60 - 20 * k, 1), sog_codes(60 - 20 * k, 1, 10, k)
        Path(f"streamed/{k}.sog").write_bytes(sog_bytes(*stored))
        if k == 0:
            Path("fine/meta.json").write_text(json.dumps(stored[0]))
            for name, pixels in stored[1].items():
                Path(f"fine/{name}.webp").write_bytes(image_bytes(pixels))
    shutil.copy("streamed/0.sog", "fine.sog")
    opened.cache_clear()
    return folder


def test_render(place, capsys):
    """Level 0 is the default and the scene of fine.sog; level 1 is another picture."""
    options = {"fine.sog": "", "fine": "", "streamed": "", "streamed/lod-meta.json": "--lod 0"}
    options["./streamed"] = "--lod 1"
    pictures = []
    for number, (scene, option) in enumerate(options.items()):
        written = f"-o {number}.png --size 64x48 --camera cameras.json --json {number}.json"
        assert run(f"render {scene} {written} {option}") == 0
        pictures.append(read_png(f"{number}.png"))
    assert all(np.array_equal(picture, pictures[0]) for picture in pictures[1:4])
    assert not np.array_equal(pictures[4], pictures[0])
    assert "level of detail 1 of 0 … 1 (see --lod): 40 Gaussians" in capsys.readouterr().err
    assert "level of detail 1" in load(Path("4.json"))["notes"][0]


def test_packed_by_level(place):
    """A model is packed of the level that is given; info and join take it, too."""
    for lod, count in ((0, 60), (1, 40)):
        given = f"--lod {lod}"
        assert run(f"pack streamed -o a.splatcore --quality faithful {given} --json a.json") == 0
        assert load(Path("a.json"))["gaussians"] == count
        assert run(f"info streamed {given} --json b.json") == 0
        assert load(Path("b.json"))["gaussians"] == count
        assert run(f"join streamed streamed -o b.ply {given}") == 0
        assert len(splatcore.open_scene("b.ply")) == 2 * count


def test_refused(place, capsys):
    message = "streamed/lod-meta.json: --lod 2: has levels 0 .the finest. … 1"
    check_refused(capsys, "render streamed -o a.png --lod 2", message)
    for scene, why in {
        "fine.sog": "fine.sog: --lod 1: only a streamed SOG has levels of detail",
        "scene.ply": "only a streamed SOG has levels of detail",
        "garden": "--lod 1: garden is generated, without levels of detail",
    }.items():
        check_refused(capsys, f"render {scene} -o a.png --lod 1", why)
    assert run("pack scene.ply -o a.splatcore --quality faithful") == 0
    message = "--lod 1: a.splatcore: a packed model has its own level of detail; repack the scene"
    check_refused(capsys, "render a.splatcore -o a.png --lod 1", message)


def test_views_of_other_levels_have_other_names():
    """Results are kept by name, so results of one level are not reused for another."""
    names = {View("streamed", reading=Reading(lod=lod)).name for lod in (None, 0, 1)}
    assert names == {"streamed", "streamed --lod 0", "streamed --lod 1"}
    assert Reading(lod=1, near=0.5).reading == Reading(None, None, 1, 0.5)


def test_python(place):
    assert len(splatcore.open_scene("streamed")) == 60
    assert len(splatcore.open_scene("streamed", lod=1)) == 40
    for lod, message in ((-1, "--lod -1: is negative"), (1.5, "lod: is of type float")):
        with pytest.raises(InputError, match=message):
            splatcore.open_scene("streamed", lod=lod)


def test_cameras_beside(place):
    """KSPLAT and gzipped PLY files are scenes of a folder, with cameras next to them."""
    Path("a.ksplat").write_bytes(small_ksplat(1, 1))
    Path("b.ply.gz").write_bytes(b"")
    Path("c.gz").write_bytes(b"")
    for name in "abc":
        shutil.copy("cameras.json", f"{name}.cameras.json")
    names = [path.name for path in scene_files(place)]
    assert names == ["a.ksplat", "b.ply.gz", "fine.sog", "scene.ply"]
    found = [camera_beside(name) for name in ("a.ksplat", "b.ply.gz", "c.gz")]
    assert found == ["a.cameras.json", "b.cameras.json", None]
    shutil.copy("cameras.json", "fine/cameras.json")
    for name in ("fine", "fine/meta.json", "fine/lod-meta.json"):
        assert camera_beside(name) == "fine/cameras.json"
