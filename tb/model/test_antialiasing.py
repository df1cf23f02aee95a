"""The antialiased mark of scenes (how each format states it, what keeps it), and notes on odd
Gaussians of any format."""

import json
from dataclasses import replace

import numpy as np
import pytest
from plyfile import PlyData

from splatcore.golden.reference import render
from splatcore.model.cameras.join import side_by_side
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.hard_case import together
from splatcore.model.pack.pack import pack
from splatcore.spec.camera import look_at
from splatcore.spec.config import DEFAULT
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene
from tb.helpers.harmonics import harmonics
from tb.helpers.refusal import refused
from tb.helpers.scene_file import (
    compressed_ply,
    ply_bytes,
    ply_columns,
    read_written,
    sog_bytes,
    sog_codes,
    sog_meta,
    spz_bytes,
    spz_codes,
)
from tb.helpers.scenes import random_scene

UNMARKED = (False, "")


def mark(scene: Scene) -> tuple[bool, str]:
    assert scene.gaussians().antialiased == scene.antialiased
    return scene.antialiased, scene.mark


def plain(tmp_path, *comments: str, **columns: np.ndarray) -> Scene:
    """Read a PLY of three Gaussians with additional columns."""
    table = ply_columns(random_scene(3, 0)) | columns
    data = ply_bytes({"vertex": table}, comments=comments)
    return read_written(tmp_path / "scene.ply", data)


def compressed(tmp_path, *comments: str) -> Scene:
    """Read a compressed PLY of three Gaussians."""
    return read_written(tmp_path / "scene.ply", compressed_ply(3, comments=comments))


@pytest.mark.parametrize("make", [plain, compressed])
@pytest.mark.parametrize(
    "comment, antialiased",
    {
        "SplatRenderMode: mip": True,
        "SplatRenderMode: default": False,
        "  SPLATRENDERMODE:   MIP ": True,
        "splatRenderMode:mip": True,
        "antialiased 1": True,
        "antialiased 0": False,
        "Antialiased:  true": True,
        "antialiased=false": False,
    }.items(),
)
def test_ply_comments(tmp_path, make, comment, antialiased):
    """Brush's and Postshot's comments set the mark, in any case and spacing and either kind of
    PLY."""
    text = " ".join(comment.split())
    assert mark(make(tmp_path, "SH degree: 0", comment)) == (antialiased, f"PLY comment '{text}'")


@pytest.mark.parametrize("make", [plain, compressed])
@pytest.mark.parametrize(
    "comment",
    ["", "SplatRenderMode: 2dgs", "not antialiased 1 at all", "SplatRenderMode: mipmap", "mip"],
)
def test_other_ply_comments(tmp_path, make, comment):
    """Comments that only resemble a statement leave the scene unmarked."""
    assert mark(make(tmp_path, comment)) == UNMARKED


def test_last_ply_comment_counts(tmp_path):
    """The last of several statements wins, as in splat-transform."""
    assert plain(tmp_path, "SplatRenderMode: default", "antialiased 1").antialiased
    assert not plain(tmp_path, "antialiased 1", "SplatRenderMode: default").antialiased


@pytest.mark.parametrize("newline", ["\r\n", "\r"])
def test_line_ends_of_ply_comments(tmp_path, newline):
    """The line end, CRLF or CR, is not part of the comment."""
    elements = {"vertex": ply_columns(random_scene(3, 0))}
    data = ply_bytes(elements, "ascii", newline=newline, comments=("antialiased 1",))
    assert mark(read_written(tmp_path / "scene.ply", data)) == (True, "PLY comment 'antialiased 1'")


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_spz_flag(tmp_path, version):
    """Bit 0 sets the mark; a clear bit states nothing, because converters drop the flag."""
    found = {}
    for flags in (0, 1, 4):
        data = spz_bytes(version, spz_codes(version, 5, 1), 1, flags=flags)
        scene = read_written(tmp_path / f"{flags}.spz", data)
        found[flags] = mark(scene)
    assert found == {0: UNMARKED, 1: (True, "SPZ flag"), 4: UNMARKED}


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(
    "stated, expected",
    [
        ({}, UNMARKED),
        ({"model": "antialiased"}, (True, 'SOG "model": "antialiased"')),
        ({"antialias": True}, (True, 'SOG "antialias": true')),
        ({"antialias": False}, (False, 'SOG "antialias": false')),
        ({"model": "2dgs"}, UNMARKED),
        ({"model": "antialiased", "antialias": False}, (True, 'SOG "model": "antialiased"')),
        ({"model": [1], "antialias": "true"}, UNMARKED),
        ({"asset": {"model": "antialiased"}}, UNMARKED),
    ],
)
def test_sog_meta(tmp_path, version, stated, expected):
    """Only top-level keys of meta.json count: splat-transform's and GaussForge's."""
    meta = json.dumps(sog_meta(version, 17, 0) | stated)
    data = sog_bytes(meta, sog_codes(17, 0, 5))
    assert mark(read_written(tmp_path / "scene.sog", data)) == expected


def test_filter_3d_is_fused(tmp_path):
    """Fused by Mip-Splatting's formulas, with a note and the mark; a comment overrides the mark."""
    width = np.array([0.15, 0.0, 3.0])
    bare = plain(tmp_path)
    scene = plain(tmp_path, filter_3D=width)
    right = np.sqrt(bare.scale**2 + np.float32(width)[:, None].astype(float) ** 2)
    assert np.allclose(scene.scale, right, rtol=1e-12)
    share = np.sqrt((bare.scale**2).prod(1) / (right**2).prod(1))
    assert np.allclose(scene.opacity, bare.opacity * share, rtol=1e-12)
    assert share[1] == 1 and share[2] < 0.1  # a filter of 0 changes nothing, a wide one a lot
    assert scene.notes[0] == "filter_3D (Mip-Splatting) fused into scales and opacities"
    assert mark(scene) == (True, "PLY column filter_3D")
    assert not plain(tmp_path, "SplatRenderMode: default", filter_3D=width).antialiased


def test_filter_3d_of_flat_gaussians(tmp_path):
    """Scales that are 0 or tiny: no division by zero, no underflow of their product."""
    columns = {f"scale_{k}": np.array([-np.inf, -400.0, -np.inf]) for k in range(3)}
    scene = plain(tmp_path, filter_3D=np.array([0.5, 0.0, 0.0]), **columns)
    bare = plain(tmp_path)
    assert np.array_equal(scene.opacity, bare.opacity * [0, 1, 1])
    assert np.allclose(scene.scale[:, 0], [0.5, np.exp(-400), 0], rtol=1e-6)


def test_filter_3d_has_the_right_picture(tmp_path):
    """A file with filter_3D renders like a file whose writer fused it, within float32 rounding."""
    bare = random_scene(60, 0)
    wide = np.sqrt(bare.scale**2 + 0.15**2)
    dim = bare.opacity * np.sqrt((bare.scale**2).prod(1) / (wide**2).prod(1))
    columns, fused = ply_columns(bare), ply_columns(replace(bare, scale=wide, opacity=dim))
    camera = look_at([0, 0, -6.0], [0, 0, 0.0], 64, 48, 60.0, [0, 1.0, 0])
    pictures = []
    for table in (columns | {"filter_3D": np.full(60, 0.15)}, fused, columns):
        data = ply_bytes({"vertex": table}, comments=("antialiased 0",))
        scene = read_written(tmp_path / "scene.ply", data)
        pictures.append(render(scene.gaussians(), camera).image)
    error, unfused = (np.abs(image - pictures[1]).max() for image in pictures[::2])
    assert error < 1e-5 < 0.01 < unfused


def test_unknown_columns_are_named(tmp_path):
    """A note names at most eight unused columns; normals are expected and not named."""
    extra = {name: np.zeros(3) for name in ("nx", "ny", "nz", "label", "filter_3dx", "semantic_0")}
    assert plain(tmp_path, **extra).notes == (
        "columns that are not used: label, filter_3dx, semantic_0",
    )
    many = {f"feature_{k}": np.zeros(3) for k in range(30)}
    (note,) = plain(tmp_path, **many).notes
    assert note.startswith("columns that are not used: feature_0, ")
    assert note.endswith("feature_7 and 22 more")


def test_written_ply_keeps_the_mark(tmp_path):
    """write_ply states the mark by splat-transform's comment; unmarked scenes get no comment."""
    scene = random_scene(3, 1)
    for antialiased in (True, False):
        path = tmp_path / "scene.ply"
        write_ply(path, replace(scene, antialiased=antialiased))
        comments = PlyData.read(path).comments
        assert comments == (["SplatRenderMode: mip"] if antialiased else [])
        assert read_scene(path).antialiased == antialiased


def view(antialiased: bool, name: str) -> tuple:
    """A scene of 20 Gaussians with or without the mark, and a camera."""
    scene = replace(random_scene(20, 0), antialiased=antialiased, mark="a test", name=name)
    return scene, look_at([0, 0, -6.0], [0, 0, 0.0], 64, 48, 60.0, [0, 1.0, 0])


@pytest.mark.parametrize("antialiased", [True, False])
def test_joined_scenes_keep_the_mark(antialiased):
    """Scenes in view decide the mark; the scene behind the camera is never drawn."""
    behind = view(not antialiased, "behind")[0]
    joined, _ = side_by_side([view(antialiased, "a"), view(antialiased, "b")], behind)
    assert mark(joined) == (antialiased, "a test") and len(joined) == 60


@pytest.mark.parametrize("first", [True, False])
def test_joined_scenes_of_different_marks(first):
    names = {first: "a", not first: "b"}
    message = f"^{names[True]} is antialiased, {names[False]} is not; choose --antialiased or "
    refused(message, side_by_side, [view(first, "a"), view(not first, "b")])


def test_scenes_of_scenes_keep_the_mark():
    """Concatenating, slicing and cutting harmonics keep the mark."""
    marked = view(True, "a")[0]
    assert mark(together(marked, marked)) == (True, "a test")
    assert mark(marked[:3]) == mark(marked.with_sh_degree(0)) == (True, "a test")


@pytest.mark.parametrize("antialiased", [True, False])
def test_packed_models_keep_the_mark(antialiased):
    """The mark survives in the bytes of the packed model."""
    model = pack(view(antialiased, "a")[0], DEFAULT)[0]
    again = PackedModel(model.image, "again")
    assert again.antialiased == again.gaussians().antialiased == antialiased


C0 = np.sqrt(1 / (4 * np.pi))


def notes_of(tmp_path, scene: Scene) -> tuple[str, ...]:
    data = ply_bytes({"vertex": ply_columns(scene)})
    return read_written(tmp_path / "scene.ply", data).notes


@pytest.mark.parametrize("degree", range(4))
def test_colours_that_saturate(tmp_path, degree):
    """Colours of 8 or more in any channel, from the constant term alone or along one direction."""
    scene = random_scene(20, degree)
    scene.sh[3, 0, 1] = 7.51 / C0
    scene.sh[4, 0, 2] = 30
    scene.sh[5, 0, 0] = 7.4 / C0  # its own colour is 7.9
    scene.sh[6, 0] = -30
    scene.sh[3:7, 1:] = 0
    count = 2
    if degree:
        scene.sh[7] = 0
        scene.sh[7, 0, 0] = 7 / C0
        scene.sh[7, degree * degree, 0] = 2  # 0.5 + 7 + 2 · at least 0.48
        count = 3
    note = f"{count} Gaussians with colours from 8 on, which saturate in the machine"
    assert notes_of(tmp_path, scene) == (note,)
    scene.sh[3:8] /= 10
    assert notes_of(tmp_path, scene) == ()


def test_bright_sides_by_brute_force(tmp_path):
    """The count in the note, against the brightest of 2,000 random directions."""
    scene = random_scene(3000, 3)
    scene.sh[...] *= np.random.default_rng(1).uniform(0, 8, (3000, 1, 1))
    direction = np.random.default_rng(2).normal(size=(2000, 3))
    colour = 0.5 + np.einsum("dk,nkc->ndc", harmonics(direction, 3), scene.sh.astype(np.float32))
    brightest = colour.max(axis=(1, 2))
    (note,) = notes_of(tmp_path, scene)
    found = int(note.split()[0])
    # One of 2,000 directions is almost surely within 8° of the brightest one.
    assert (brightest > 8.4).sum() <= found <= (brightest > 7.9).sum()
    assert (brightest > 8).sum() > 300


def test_transparent_gaussians(tmp_path):
    scene = random_scene(20, 0)
    scene.opacity[[2, 7]], scene.opacity[3] = 1 / 260, 1 / 254
    assert notes_of(tmp_path, scene) == ("2 transparent Gaussians (opacity below 1/255)",)
    columns = ply_columns(scene)
    columns["opacity"][2] = np.nan
    scene = read_written(tmp_path / "scene.ply", ply_bytes({"vertex": columns}))
    faint = "1 transparent Gaussian (opacity below 1/255)"
    assert scene.notes == ("1 Gaussian with NaN or Inf", faint)
