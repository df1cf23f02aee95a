"""PLY containers: lists, comments of any bytes, surplus rows, upper-case names, plain colours."""

import gzip
import struct

import numpy as np
import pytest

from splatcore.spec.scene import Scene
from tb.helpers.scene_file import (
    check_bad_scene,
    compressed_ply,
    ply_bytes,
    ply_columns,
    read_written,
)
from tb.helpers.scenes import random_scene

COLUMNS = ply_columns(random_scene(4, 1))
FORMS = ("ascii", "binary_little_endian", "binary_big_endian")
ORDER = {"binary_little_endian": "<", "binary_big_endian": ">"}
END = b"end_header\n"


def scene_of(tmp_path, data: bytes) -> Scene:
    return read_written(tmp_path / "scene.ply", data)


def rows(form: str, lengths: tuple[int, ...]) -> bytes:
    """Rows of faces: a list of corners, a flag, and a list of two weights."""
    if form == "ascii":
        words = [[n, *range(n), 7, 2, 0.5, 0.5] for n in lengths]
        return b"".join(" ".join(map(str, row)).encode() + b"\n" for row in words)
    found = b""
    for n in lengths:
        found += struct.pack(f"{ORDER[form]}B{n}ihI2f", n, *range(n), 7, 2, 0.5, 0.5)
    return found


FACE = b"""property list uchar int vertex_indices
property short flag
property list uint float weights
"""


def with_faces(form: str, lengths: tuple[int, ...], before: bool) -> bytes:
    """A PLY with an element of lists before or after its Gaussians."""
    head, _, body = ply_bytes({"vertex": COLUMNS}, form).partition(END)
    element = f"element face {len(lengths)}\n".encode() + FACE
    if before:
        start, vertex, rest = head.partition(b"element vertex")
        return start + element + vertex + rest + END + rows(form, lengths) + body
    return head + element + END + body + rows(form, lengths)


@pytest.mark.parametrize("before", [True, False])
@pytest.mark.parametrize("lengths", [(), (3,) * 50, (3, 4, 3, 1, 5), (3, 3, 3, 3, 4)])
@pytest.mark.parametrize("form", FORMS)
def test_lists_outside_of_vertex_are_skipped(tmp_path, form, lengths, before):
    """No lists, lists of one length, and lists of different lengths."""
    plain = scene_of(tmp_path, ply_bytes({"vertex": COLUMNS}, form))
    scene = scene_of(tmp_path, with_faces(form, lengths, before))
    assert np.array_equal(scene.position, plain.position) and np.array_equal(scene.sh, plain.sh)
    assert scene.notes == (("elements that are not used: face",) if lengths else ())


@pytest.mark.parametrize("before", [True, False])
@pytest.mark.parametrize("form", FORMS)
def test_lists_that_are_cut_off(tmp_path, form, before):
    data = with_faces(form, (3, 4, 5), before)
    cut = data[:-2] if not before else data[: data.index(END) + len(END) + 20]
    message = {"ascii": "rows" if before else "'face': has 3"}.get(form, "lists are cut off")
    if form == "ascii" and not before:
        cut = data[: data.rstrip().rindex(b"\n") + 1]
        message = "element 'face': has 2 of 3 rows"
    check_bad_scene(tmp_path / "scene.ply", cut, message)


def test_a_list_of_a_negative_length(tmp_path):
    data = with_faces("binary_little_endian", (3,), True).replace(b"list uchar", b"list char")
    start = data.index(END) + len(END)
    data = data[:start] + b"\xff" + data[start + 1 :]
    check_bad_scene(tmp_path / "scene.ply", data, "a list of -1 items")


def test_lists_of_gaussians_are_refused(tmp_path):
    data = with_faces("ascii", (3,), True).replace(b"element face", b"element chunk")
    check_bad_scene(tmp_path / "scene.ply", data, "element 'chunk' has list properties")


@pytest.mark.parametrize("comment", ["Größe: 3 µm", "日本", "\x7f\x00"])
@pytest.mark.parametrize("form", FORMS)
def test_comments_are_free_text(tmp_path, form, comment):
    data = ply_bytes({"vertex": COLUMNS}, form, comments=(comment, "antialiased 1"))
    assert scene_of(tmp_path, data).mark == "PLY comment 'antialiased 1'"
    other = data.replace(comment.encode(), b"\xff\xfe no UTF-8").replace(b"comment", b"obj_info")
    assert scene_of(tmp_path, other).antialiased


@pytest.mark.parametrize("form", FORMS)
def test_more_rows_than_the_header_says(tmp_path, form):
    """Surplus rows at the end are noted; before another element they are refused."""
    data = ply_bytes({"vertex": COLUMNS}, form)
    scene = scene_of(tmp_path, data.replace(b"element vertex 4", b"element vertex 3"))
    note = "the header says 3 Gaussians, the file holds 4"
    assert len(scene) == 3 and scene.notes == (f"{note}: the rest is not read",)
    followed = ply_bytes({"vertex": COLUMNS, "camera": {"focal": np.ones(2)}}, form)
    data = followed.replace(b"element vertex 4", b"element vertex 3")
    says = "element 'camera': row 0 has 23 values, not 1" if form == "ascii" else note
    check_bad_scene(tmp_path / "scene.ply", data, says)
    data = ply_bytes({"vertex": COLUMNS}, form)
    few = scene_of(tmp_path, data + (b"\n\n" if form == "ascii" else b"abc"))
    assert few.notes == (
        () if form == "ascii" else ("3 bytes belong to no Gaussian and are not read",)
    )


def test_more_rows_in_a_compressed_ply(tmp_path):
    for degree in (0, 1):
        data = compressed_ply(10, degree)
        data = data.replace(b"vertex 10", b"vertex 8").replace(b"element sh 10", b"element sh 8")
        note = "the header says 8 Gaussians, the file holds 10"
        if degree:
            check_bad_scene(tmp_path / "scene.ply", data, "the header says 8 Gaussians")
        else:
            assert scene_of(tmp_path, data).notes[0] == f"{note}: the rest is not read"


@pytest.mark.parametrize("form", FORMS)
def test_names_in_upper_case(tmp_path, form):
    """Names match in any case (`F_REST_*` used to be dropped silently); exact ones come first."""
    expected = scene_of(tmp_path, ply_bytes({"vertex": COLUMNS}, form))
    for change in (str.upper, lambda name: name.replace("f_rest", "F_REST")):
        columns = {change(name): column for name, column in COLUMNS.items()}
        scene = scene_of(tmp_path, ply_bytes({"vertex": columns}, form))
        assert np.array_equal(scene.sh, expected.sh) and scene.sh_degree == 1
        assert scene.notes == ()
    twice = COLUMNS | {"X": COLUMNS["x"] + 9, "OTHER": COLUMNS["x"]}
    scene = scene_of(tmp_path, ply_bytes({"vertex": twice}, form))
    assert np.array_equal(scene.position, expected.position)
    assert scene.notes == ("columns that are not used: X, OTHER",)


@pytest.mark.parametrize("kind", ["uchar", "uint", "float"])
@pytest.mark.parametrize("rest", [False, True])
def test_plain_colours(tmp_path, kind, rest):
    """nerfstudio's rgb mode: columns red, green, blue in place of f_dc."""
    values = np.random.default_rng(0).integers(0, 256, (4, 3))
    kept = {n: c for n, c in COLUMNS.items() if "f_dc" not in n and (rest or "f_rest" not in n)}
    whole = {"uchar": 255, "uint": 2**32 - 1, "float": 1}[kind]
    stored = np.rint(values / 255 * whole) if whole > 1 else values / 255
    names = ("red", "green", "blue")
    types = dict.fromkeys(names, kind)
    data = ply_bytes({"vertex": kept | dict(zip(names, stored.T, strict=True))}, types=types)
    scene = scene_of(tmp_path, data)
    assert scene.sh_degree == 0
    assert np.abs(0.5 + np.sqrt(1 / (4 * np.pi)) * scene.sh[:, 0] - values / 255).max() < 1e-6
    notes = ("colours are red, green, blue, without f_dc: SH degree 0",)
    assert scene.notes[:1] == notes and ("f_rest_0" in scene.notes[-1]) == rest


@pytest.mark.parametrize("form", FORMS)
def test_gzip_stream(tmp_path, form):
    """A gzipped PLY of any form and name is read; also one of several streams."""
    data = ply_bytes({"vertex": COLUMNS}, form)
    expected = scene_of(tmp_path, data)
    for packed in (gzip.compress(data), gzip.compress(data[:99]) + gzip.compress(data[99:])):
        for name in ("scene.ply.gz", "scene.gz", "scene.ply"):
            scene = read_written(tmp_path / name, packed)
            assert np.array_equal(scene.sh, expected.sh) and scene.notes == expected.notes
    data = compressed_ply(10, 1)
    scene = read_written(tmp_path / "scene.ply.gz", gzip.compress(data))
    assert np.array_equal(scene.position, scene_of(tmp_path, data).position)


def test_bad_gzip_streams(tmp_path):
    """Streams are unpacked up to 100 times their size."""
    data = ply_bytes({"vertex": COLUMNS})
    for message, packed in {
        "cannot be read": gzip.compress(data)[:-9],
        "cannot be read ": gzip.compress(data)[:-8] + bytes(8),
        "unpacks to more than 100 times its size": gzip.compress(data + bytes(1 << 20)),
        "has 3 of 4 rows": gzip.compress(data[:-1]),
        "has no 'end_header'": gzip.compress(data[:20]),
    }.items():
        check_bad_scene(tmp_path / "scene.ply.gz", packed, message)


BAD = {
    "two elements have the same name": b"element vertex 1\nproperty float x\n" * 2,
    "unknown property 'float'": b"element vertex 1\nproperty float\n",
    "unknown property 'half x'": b"element vertex 1\nproperty half x\n",
    "unknown property 'list float int x'": b"element face 1\nproperty list float int x\n",
    "unknown line 'property float x'": b"property float x\n",
}


@pytest.mark.parametrize("message", BAD)
def test_bad_header(tmp_path, message):
    data = b"ply\nformat ascii 1.0\n" + BAD[message] + b"end_header\n1\n"
    check_bad_scene(tmp_path / "scene.ply", data, message)


def test_other_bad_headers(tmp_path):
    path = tmp_path / "scene.ply"
    check_bad_scene(path, b"ply\nelement vertex 1\nend_header\n", "'format' is missing")
    columns = {"x": np.array([1.0]), "y": np.array([2.0])}
    data = ply_bytes({"vertex": columns}, "ascii", {"y": "uchar"}).replace(b"2", b"256")
    check_bad_scene(path, data, "property 'y' is not in 0 … 255")
