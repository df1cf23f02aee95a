"""SOG scenes, versions 1 and 2 (every image decoded, agreement with PLY), and .splat scenes, which
are known by their extension; malformed files."""

import io
import json
import struct
import zipfile

import numpy as np
import pytest

from splatcore.model.formats.read import read_scene
from splatcore.spec.scene import rotation_matrix
from tb.helpers.refusal import refused
from tb.helpers.scene_file import (
    check_bad_scene,
    edited,
    image_bytes,
    ply_bytes,
    ply_columns,
    read_written,
    sog_bytes,
    sog_codes,
    sog_meta,
    splat_bytes,
)
from tb.helpers.scenes import needs_scenes, random_scene, scene_path


def read(tmp_path, data: bytes):
    return read_written(tmp_path / "scene.sog", data)


@pytest.mark.parametrize("version", [1, 2])
def test_every_image(tmp_path, version):
    """Each Gaussian decoded by the format's formulas, one at a time: 17 in images of 4×5 pixels."""
    count, width = 17, 5
    codes, meta = sog_codes(count, 0, width), sog_meta(version, count, 0)
    codes["sh0"].reshape(-1, 4)[:count, 3] |= 4  # none is transparent
    codes["quats"].reshape(-1, 4)[count:] = 0  # padding
    scene = read(tmp_path, sog_bytes(meta, codes))
    assert (len(scene), scene.sh_degree, scene.notes) == (count, 0, ())

    def value(name: str, code: int, channel: int) -> float:
        if version == 2:
            return meta[name]["codebook"][code]
        low, high = meta[name]["mins"][channel], meta[name]["maxs"][channel]
        return low + (high - low) * code / 255

    for i in range(count):
        pixel = {name: image[i // width, i % width].astype(int) for name, image in codes.items()}
        for axis in range(3):
            low, high = meta["means"]["mins"][axis], meta["means"]["maxs"][axis]
            code = pixel["means_l"][axis] + 256 * pixel["means_u"][axis]
            log = low + (high - low) * code / 65535
            position = np.expm1(abs(log)) * np.sign(log)
            assert abs(scene.position[i, axis] - position) < 1e-12
            scale = np.exp(value("scales", pixel["scales"][axis], axis))
            assert abs(scene.scale[i, axis] / scale - 1) < 1e-12
            assert abs(scene.sh[i, 0, axis] - value("sh0", pixel["sh0"][axis], axis)) < 1e-12
        alpha = pixel["sh0"][3]
        opacity = alpha / 255 if version == 2 else 1 / (1 + np.exp(-value("sh0", alpha, 3)))
        assert abs(scene.opacity[i] - opacity) < 1e-12


def test_quaternions(tmp_path):
    """Rotations of known quaternions, packed here by the format's description, come back."""
    count = 512
    quaternion = random_scene(count, 0).quaternion
    codes = sog_codes(count, 0, 32)
    for i, q in enumerate(quaternion):
        largest = int(np.argmax(np.abs(q)))
        small = np.delete(q * np.sign(q[largest]), largest)
        rgb = np.round((small / np.sqrt(2) + 0.5) * 255)
        codes["quats"][i // 32, i % 32] = [*rgb, 252 + largest]
    scene = read(tmp_path, sog_bytes(sog_meta(2, count, 0), codes))
    error = np.abs(rotation_matrix(scene.quaternion) - rotation_matrix(quaternion))
    assert error.max() < 0.02  # measured 0.010: steps of √2/255


def test_missing_alpha_is_opaque(tmp_path):
    """Images without alpha are opaque: encoders drop an alpha channel of only 255."""
    codes = sog_codes(4, 0, 4)
    codes["quats"][..., 3] = 255
    codes["sh0"] = codes["sh0"][..., :3].copy()
    scene = read(tmp_path, sog_bytes(sog_meta(2, 4, 0), codes))
    assert scene.opacity.tolist() == [1] * 4
    assert (np.argmax(scene.quaternion, axis=1) == 3).any()


def test_null_at_the_start_of_a_codebook(tmp_path):
    """A fault of early writers, repaired as in PlayCanvas's engine."""
    codes, meta = sog_codes(4, 0, 4), sog_meta(2, 4, 0)
    book = meta["sh0"]["codebook"] = [None, *np.linspace(-1, 1, 255).tolist()]
    codes["sh0"][...] = 0
    scene = read(tmp_path, sog_bytes(meta, codes))
    assert np.allclose(scene.sh, book[1] + (book[1] - book[255]) / 255)


@pytest.mark.parametrize("version", [1, 2])
def test_labels_without_a_centroid(tmp_path, version):
    """They give zero harmonics and a note, others stay. Version 1 has 128 centroids here."""
    codes, meta = sog_codes(6, 2, 3), sog_meta(version, 6, 2)
    count = 100 if version == 2 else 128
    whole = read(tmp_path, sog_bytes(meta, codes))
    codes["shN_labels"][0, 2] = (count, 0, 0)
    codes["shN_labels"][1, 1] = (255, 255, 0)  # splat-transform's label for NaN
    scene = read(tmp_path, sog_bytes(meta, codes))
    lost = [2, 4]
    assert not scene.sh[lost, 1:].any() and np.array_equal(scene.sh[:, 0], whole.sh[:, 0])
    assert np.array_equal(np.delete(scene.sh, lost, 0), np.delete(whole.sh, lost, 0))
    note = f"2 Gaussians have a label beyond the {count} centroids: their harmonics are 0"
    assert note in scene.notes and note not in whole.notes


@pytest.mark.parametrize("version", [1, 2])
def test_more_gaussians_than_meta_says(tmp_path, version):
    """Surplus pixels are noted, unless they are padding: no quaternion tag, or no opacity."""
    codes = sog_codes(6, 0, 3)
    codes["sh0"][..., 3] = 200
    for count, held in ((6, 0), (4, 2), (1, 5)):
        scene = read(tmp_path, sog_bytes(sog_meta(version, count, 0), codes))
        says = f"meta.json says {count} Gaussians, its images hold {count + held}"
        assert len(scene) == count
        assert scene.notes == ((f"{says}: the rest is not read",) if held else ())
    codes["quats"][1, 1:, 3], codes["sh0"][1, 0, 3] = 0, 0
    assert read(tmp_path, sog_bytes(sog_meta(version, 3, 0), codes)).notes == ()


@needs_scenes
def test_agrees_with_ply():
    """leica-sofort as PLY and as SOG: each Gaussian against the nearest in the other file.

    Bounds are 1.5 to 2 times the measured errors (in the comments).
    """
    ply = read_scene(scene_path("leica-sofort-top8192.ply"))
    sog = read_scene(scene_path("leica-sofort-top8192.sog"))
    away = (sog.position - part[:, None] for part in np.array_split(ply.position, 32))
    nearest = np.concatenate([np.argmin((each**2).sum(axis=2), axis=1) for each in away])
    assert len(set(nearest)) == len(ply)  # one to one
    sog = sog[nearest]
    position = np.abs(sog.position - ply.position) / (1 + np.abs(ply.position))
    assert position.max() < 1.5e-4  # measured 8.6e-5, one step of the 16-bit logarithm
    assert np.abs(np.log(sog.scale / ply.scale)).max() < 0.15  # measured 0.082
    cosine = np.abs((sog.quaternion * ply.quaternion).sum(axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(cosine, 1))).max() < 3  # measured 1.7
    assert np.abs(sog.opacity - ply.opacity).max() < 1.001 / 255  # measured 1.000 / 255
    error = np.abs(sog.sh - ply.sh)
    assert error[:, 0].max() < 0.06  # measured 0.032
    # Each Gaussian has its own centroid, so its harmonics are the entries nearest to the PLY's.
    with zipfile.ZipFile(scene_path("leica-sofort-top8192.sog")) as archive:
        codebook = np.array(json.loads(archive.read("meta.json"))["shN"]["codebook"])
    above = np.clip(np.searchsorted(codebook, ply.sh[:, 1:]), 1, len(codebook) - 1)
    away = np.abs(codebook[[above - 1, above]] - ply.sh[:, 1:]).min(axis=0)
    assert np.abs(error[:, 1:] - away).max() < 1e-12


META = sog_meta(2, 6, 1)
CODES = sog_codes(6, 1, 3)


def _meta(*keys: object, version: int = 2) -> bytes:
    """A file whose meta.json has one value replaced (the last of `keys`) or removed (None)."""
    return sog_bytes(edited(META if version == 2 else sog_meta(1, 6, 1), *keys), CODES)


def _image(name: str, pixels: np.ndarray | bytes | None) -> bytes:
    """A file with one image replaced or removed."""
    codes = CODES | {name: pixels}
    return sog_bytes(META, {k: v for k, v in codes.items() if v is not None})


def _zip(name: str, compression: int = zipfile.ZIP_STORED) -> bytes:
    """A zip archive with one file."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        archive.writestr(name, "{}")
    return file.getvalue()


def _pixel(name: str, y: int, x: int, value: object) -> bytes:
    """A file with one pixel of an image replaced."""
    pixels = CODES[name].copy()
    pixels[y, x] = value
    return _image(name, pixels)


GOOD = sog_bytes(META, CODES)
ENCRYPTED = bytearray(GOOD)
ENCRYPTED[GOOD.index(b"PK\x01\x02") + 8] |= 1
LONG = bytearray(GOOD)
struct.pack_into("<I", LONG, GOOD.index(b"PK\x01\x02") + 24, 10**9)
TEXT = json.dumps(META)

BAD = {
    "is not a zip archive": GOOD[:200],
    "no meta.json": _zip("other.json"),
    "meta.json: claims 1000000000 bytes": bytes(LONG),
    "zip compression 12": _zip("meta.json", zipfile.ZIP_BZIP2),
    "encrypted": bytes(ENCRYPTED),
    "is not valid JSON": sog_bytes(TEXT[:-1], CODES),
    "NaN is not JSON": sog_bytes(TEXT.replace('"count": 6', '"count": NaN'), CODES),
    "meta.json: is [], not an object": sog_bytes([], CODES),
    "recursion": sog_bytes("[" * 100_000, CODES),
    "version 3": _meta("version", 3),
    "'version': is '2', not an integer": _meta("version", "2"),
    "'version': is True": _meta("version", True),
    "'count' is missing": _meta("count", None),
    "'count': is '6'": _meta("count", "6"),
    "'count': is 6.5": _meta("count", 6.5),
    "holds 0 Gaussians": _meta("count", 0),
    "7 Gaussians exceed images of 3×2": _meta("count", 7),
    "'shape' is missing": _meta("means", "shape", None, version=1),
    "'shape' is empty": _meta("means", "shape", [], version=1),
    "'shape': is 'x'": _meta("means", "shape", ["x", 3], version=1),
    "'means' is missing": _meta("means", None),
    "'means': is [], not an object": _meta("means", []),
    "means: 'mins' is missing": _meta("means", "mins", None),
    "means: 'mins': has 2 entries, not 3": _meta("means", "mins", [0, 1]),
    "means: 'maxs': is '1', not a number": _meta("means", "maxs", [0, 1, "1"]),
    "means: 'maxs': is 1000": _meta("means", "maxs", [0, 1, 10**400]),
    "means: 'maxs': is False": _meta("means", "maxs", [0, 1, False]),
    "means: 'files' has 1 entries, not 2": _meta("means", "files", ["means_l.webp"]),
    "means: 'files': is 3, not a string": _meta("means", "files", [3, 4]),
    "quats: 'files': is 'q', not a list": _meta("quats", "files", "q"),
    "no none.webp": _meta("quats", "files", ["none.webp"]),
    "scales: 'codebook' is missing": _meta("scales", "codebook", None),
    "scales: 'codebook' has 0": _meta("scales", "codebook", []),
    "scales: 'codebook' has 257": _meta("scales", "codebook", [0] * 257),
    "is outside its 'codebook'": _meta("scales", "codebook", [0] * 9),
    "sh0: 'codebook': is None": _meta("sh0", "codebook", [0, None]),
    "sh0: 'mins': has 3 entries, not 4": _meta("sh0", "mins", [0] * 3, version=1),
    "shN: 'mins': is [0], not a number": _meta("shN", "mins", [0], version=1),
    "shN: 'bands' is missing": _meta("shN", "bands", None),
    "SH degree is not 1, 2 or 3": _meta("shN", "bands", 4),
    "100 × 8 centroids do not match 192×2": _meta("shN", "bands", 2),
    "129 × 3 centroids": _meta("shN", "count", 129),
    "0 × 3 centroids": _meta("shN", "count", 0),
    "Gaussian 3 has the wrong tag 251": _pixel("quats", 1, 0, 251),
    "no sh0.webp": _image("sh0", None),
    "no shN_centroids.webp": _image("shN_centroids", None),
    "100 × 3 centroids do not match 192×1": _image("shN_centroids", CODES["shN_centroids"][:1]),
    "shN: 'shape' does not match 3 coefficients": _meta("shN", "shape", [6, 24], version=1),
    "sh0.webp: is not a WebP or PNG": _image("sh0", b"RIFF"),
    "sh0.webp: is a broken image": _image("sh0", image_bytes(CODES["sh0"])[:-12] + bytes(12)),
    "scales is 2×3, not 3×2": _image("scales", CODES["scales"].reshape(3, 2, 4)),
    "mode L, not RGB or RGBA": _image("sh0", image_bytes(CODES["sh0"][..., 0], "PNG")),
    "sh0.webp: claims 64000000 bytes": _image("sh0", np.zeros((4000, 4000, 4), np.uint8)),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_file(tmp_path, message):
    check_bad_scene(tmp_path / "scene.sog", BAD[message], message)


def read_splat(tmp_path, data: bytes):
    return read_written(tmp_path / "scene.splat", data)


def test_one_record(tmp_path):
    """Every field of one Gaussian, in the order of the format."""
    record = struct.pack("<6f8B", 1, -2, 3, 0.5, 0.25, 0.125, 255, 0, 51, 204, 0, 128, 160, 255)
    scene = read_splat(tmp_path, record)
    assert scene.position.tolist() == [[1, -2, 3]]
    assert scene.scale.tolist() == [[0.5, 0.25, 0.125]]
    assert scene.quaternion.tolist() == [[-1, 0, 0.25, 127 / 128]]
    assert scene.opacity.tolist() == [204 / 255]
    colour = 0.5 + 0.28209479177387814 * scene.sh[0, 0]
    assert np.abs(colour - [1, 0, 0.2]).max() < 1e-12
    assert (scene.sh_degree, scene.notes) == (0, ())


def test_many_records(tmp_path):
    """Each Gaussian reads as it does alone."""
    data = splat_bytes(20)
    scene = read_splat(tmp_path, data)
    assert len(scene) == 20
    for index in range(20):
        alone = read_splat(tmp_path, data[32 * index : 32 * index + 32])
        for name in ("position", "scale", "quaternion", "opacity", "sh"):
            assert np.array_equal(getattr(alone, name)[0], getattr(scene, name)[index])


def test_odd_gaussians_are_noted(tmp_path):
    """NaN is kept, a scale's sign is dropped, a quaternion of bytes 128 is zero."""
    grey = struct.pack("<8B", 128, 128, 128, 128, 128, 128, 128, 128)
    odd = (0, 0, 0, 1, -2, 3), (np.nan, 0, 0, 1, 2, 3)
    scene = read_splat(tmp_path, b"".join(struct.pack("<6f", *numbers) + grey for numbers in odd))
    assert scene.scale.tolist() == [[1, 2, 3]] * 2
    assert scene.notes == (
        "1 Gaussian with a negative scale, sign dropped",
        "1 Gaussian with NaN or Inf",
        "1 quaternion of norm 0",
    )


def test_content_goes_before_extension(tmp_path):
    """A PLY is read as PLY whatever its name; a .splat is known by its extension alone."""
    scene = read_splat(tmp_path, ply_bytes({"vertex": ply_columns(random_scene(3, 1))}))
    assert scene.sh_degree == 1
    (tmp_path / "scene.bin").write_bytes(splat_bytes(2))
    refused(r"is not a PLY, .*\.splat file", read_scene, tmp_path / "scene.bin")


@pytest.mark.parametrize(
    ("size", "message"), [(0, "is empty"), (31, "31 bytes are not a multiple"), (33, "33 bytes")]
)
def test_bad_size(tmp_path, size, message):
    refused(f"scene.splat: {message}", read_splat, tmp_path, splat_bytes(2)[:size])
