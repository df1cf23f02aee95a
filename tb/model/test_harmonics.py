"""Harmonics of every format and degree against the formats' definitions; wrong degrees refused.

Sources: `GaussianModel.save_ply` of 3DGS; playcanvas/splat-transform (`decompressPly`); README and
`load-spz.cc` of nianticlabs/spz; PlayCanvas's "The SOG Format". The writers and decoders here share
nothing with the readers.
"""

import gzip
import io
import json
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import zstandard
from PIL import Image

from splatcore.model.formats.read import read_scene
from splatcore.spec.scene import Scene
from tb.helpers import scene_file
from tb.helpers.harmonics import harmonics
from tb.helpers.scene_file import check_bad_scene, read_written
from tb.helpers.scenes import GAUSSIANS, needs_scenes, random_scene, scene_path

COUNT = 300
"""Enough for SOG labels of two bytes, and for more than one chunk."""

SOG_VERSIONS = ("sog 1", "sog 2")
KINDS = ("ply", "compressed ply", "spz 1", "spz 2", "spz 3", "spz 4", *SOG_VERSIONS)

DIRECTIONS = np.random.default_rng(9).normal(size=(40, 3))
"""More than 16: equal colours along all of them imply equal coefficients."""

HEADER_END = b"end_header\n"


def written(kind: str, degree: int) -> tuple[bytes, np.ndarray]:
    """A file of random harmonics, and their coefficients [N, K, 3] by the format's definition, in
    the file's axes.
    """
    rng = np.random.default_rng(degree)
    codes = rng.integers(0, 256, (COUNT, (degree + 1) ** 2 - 1, 3), np.uint8)
    channel_major = codes.transpose(0, 2, 1).reshape(COUNT, -1)  # all of red, green, blue
    if kind == "ply":
        columns = scene_file.ply_columns(random_scene(COUNT, 0))
        columns |= {f"f_rest_{i}": column / 64 - 2 for i, column in enumerate(channel_major.T)}
        return scene_file.ply_bytes({"vertex": columns}), codes / 64 - 2
    if kind == "compressed ply":
        bounds, packed = np.zeros((2, 18)), rng.integers(0, 2**32, (COUNT, 4), np.uint32)
        values = (codes + 0.5) / 32 - 4
        values[codes == 0], values[codes == 255] = -4, 4  # where the writer clamps
        return scene_file.compressed_ply_bytes(bounds, packed, channel_major), values
    version = int(kind[-1])
    if kind in SOG_VERSIONS:
        return _sog(version, codes, rng)
    sections = scene_file.spz_codes(version, COUNT, 0)[:5]
    sections.append(codes.reshape(COUNT, -1))  # the channel varies fastest
    return scene_file.spz_bytes(version, sections, degree), codes / 128 - 1


def _sog(version: int, codes: np.ndarray, rng: np.random.Generator) -> tuple[bytes, np.ndarray]:
    """A SOG file whose palette has one centroid per Gaussian, in random order."""
    images = scene_file.sog_codes(COUNT, 0, 20)
    meta = scene_file.sog_meta(version, COUNT, 0)
    coefficients = codes.shape[1]
    if coefficients == 0:
        return scene_file.sog_bytes(meta, images), np.zeros(codes.shape)
    labels = rng.permutation(COUNT)
    palette = np.zeros((-(-COUNT // 64), 64 * coefficients, 3), np.uint8)
    for code, label in zip(codes, labels, strict=True):
        column = label % 64 * coefficients
        palette[label // 64, column : column + coefficients] = code
    pixels = np.stack([labels % 256, labels // 256, 0 * labels], 1).astype(np.uint8)
    images |= {"shN_centroids": palette, "shN_labels": pixels.reshape(-1, 20, 3)}
    section = {"files": ["shN_centroids.webp", "shN_labels.webp"]}
    if version == 1:
        meta["shN"] = section | {"mins": -1.5, "maxs": 0.75, "shape": [COUNT, 3 * coefficients]}
        return scene_file.sog_bytes(meta, images), -1.5 + 2.25 * (codes / 255)
    codebook, bands = rng.normal(size=256), {3: 1, 8: 2, 15: 3}[coefficients]
    meta["shN"] = section | {"count": COUNT, "bands": bands, "codebook": codebook.tolist()}
    return scene_file.sog_bytes(meta, images), codebook[codes]


def check_same_colours(name: str, scene: Scene, values: np.ndarray) -> None:
    """Compare colours along all directions: from the scene's harmonics, and from the file's
    coefficients in the file's axes (PLY's axes, but SPZ has y up and z back).
    """
    turn = (1, -1, -1) if "spz" in name else (1, 1, 1)
    assert scene.sh[:, 1:].shape == values.shape
    theirs = harmonics(DIRECTIONS, scene.sh_degree)[:, 1:]
    ours = harmonics(DIRECTIONS * turn, scene.sh_degree)[:, 1:]
    error = np.einsum("dk,nkc", ours, scene.sh[:, 1:]) - np.einsum("dk,nkc", theirs, values)
    assert np.abs(error).max() < 1e-12


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("kind", KINDS)
def test_colours_are_those_of_the_file(tmp_path, kind, degree):
    data, values = written(kind, degree)
    scene = read_written(tmp_path / "scene", data)
    assert scene.sh_degree == degree
    check_same_colours(kind, scene, values)


def misstated(kind: str, held: int, claim: int) -> bytes:
    """A file whose header claims SH degree `claim` and whose data has degree `held`."""
    data, other = written(kind, held)[0], written(kind, claim)[0]
    if "ply" in kind:
        return other.partition(HEADER_END)[0] + HEADER_END + data.partition(HEADER_END)[2]
    if "sog" in kind:
        with zipfile.ZipFile(io.BytesIO(data)) as images, zipfile.ZipFile(io.BytesIO(other)) as its:
            files = {Path(name).stem: images.read(name) for name in images.namelist()}
            meta = its.read("meta.json").decode()
        return scene_file.sog_bytes(meta, {k: v for k, v in files.items() if k != "meta"})
    raw = data if kind == "spz 4" else gzip.decompress(data)
    raw = raw[:12] + bytes([claim]) + raw[13:]
    return raw if kind == "spz 4" else gzip.compress(raw)


@pytest.mark.parametrize("held, claim", [(0, 1), (0, 3), (1, 2), (2, 3), (3, 1), (2, 1), (3, 2)])
@pytest.mark.parametrize("kind", KINDS)
def test_degree_not_held_is_refused(tmp_path, kind, held, claim):
    """A header that contradicts the data is an error, not a scene of wrong colours."""
    field = {"ply": "'vertex'", "compressed ply": "'sh'", "sog 1": "shN", "sog 2": "shN"}
    message = field.get(kind, f"300 Gaussians of SH degree {claim}")
    if claim < held and ("ply" in kind or kind in ("spz 1", "spz 2", "spz 3")):
        message = f"claims SH degree {claim} but holds degree {held}"
    check_bad_scene(tmp_path / "scene", misstated(kind, held, claim), message)


def stored(path: Path) -> np.ndarray:
    """The coefficients [N, K, 3] in a real file, by its format's definition and in its axes."""
    return {".ply": _stored_ply, ".spz": _stored_spz_4, ".sog": _stored_sog_2}[path.suffix](path)


def _stored_ply(path: Path) -> np.ndarray:
    header, _, body = path.read_bytes().partition(HEADER_END)
    names = [line.split()[2] for line in header.decode().splitlines() if " float " in line]
    table = np.frombuffer(body, "<f4").reshape(-1, len(names))
    rest = [names.index(f"f_rest_{i}") for i in range(sum("f_rest" in name for name in names))]
    return table[:, rest].reshape(len(table), 3, -1).transpose(0, 2, 1).astype(float)


def _stored_spz_4(path: Path) -> np.ndarray:
    data = path.read_bytes()
    count, streams, toc = struct.unpack_from("<8xI3xBI", data)
    sizes = [struct.unpack_from("<Q", data, toc + 16 * i)[0] for i in range(streams)]
    start = toc + 16 * streams + sum(sizes[:-1])
    codes = zstandard.decompress(data[start : start + sizes[-1]])
    return np.frombuffer(codes, np.uint8).reshape(count, -1, 3) / 128 - 1


def _stored_sog_2(path: Path) -> np.ndarray:
    with zipfile.ZipFile(path) as archive:
        meta = json.loads(archive.read("meta.json"))
        section = meta["shN"]
        files = [Image.open(archive.open(name)).convert("RGB") for name in section["files"]]
    centroids, labels = map(np.asarray, files)
    label = labels.reshape(-1, 3)[: meta["count"]] @ np.array([1, 256, 0])
    palette = centroids.reshape(len(centroids) * 64, -1, 3)
    return np.array(section["codebook"])[palette[label]]


@needs_scenes
@pytest.mark.parametrize("name", [name for name, (_, degree) in GAUSSIANS.items() if degree])
def test_real_colours_are_those_of_the_file(name):
    scene, values = read_scene(scene_path(name)), stored(scene_path(name))
    some = slice(None, None, len(scene) // 5000)
    check_same_colours(name, scene[some], values[some])
