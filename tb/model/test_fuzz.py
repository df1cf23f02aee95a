"""Fuzzing of all file readers: a mutated file gives a sound result or an InputError.

`python -m tb.model.test_fuzz COUNT SEED` runs a longer campaign. It prints each round's number
first, which is the round to look at if the interpreter crashes.
"""

import gzip
import json
import sys
import tempfile
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from splatcore.model.formats.camera_file import read_cameras
from splatcore.model.formats.file import GZIP_MAGIC
from splatcore.model.formats.model_file import encode, file_bytes, read_model, zstd
from splatcore.model.formats.read import read_scene
from splatcore.model.pack.pack import pack
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from tb.helpers import scene_file
from tb.helpers.camera_file import colmap_binary, colmap_text, inria, transforms
from tb.helpers.clouds import cloud
from tb.helpers.gltf_file import Builder, glb_bytes, glb_parts
from tb.helpers.ksplat_file import small_ksplat
from tb.helpers.scene_file import image_bytes, sog_bytes, sog_codes, sog_meta, spz_bytes, spz_codes
from tb.helpers.scenes import random_scene

ROUNDS = 5000
ODD_VALUES = (None, True, -1, 0, 1.5, 2**31, 2**64, 1e308, "", "x", [], {}, [[]], [0] * 300)
ODD_NUMBERS = (b"0", b"-1", b"255", b"65536", b"4294967295", b"1099511627776", b"nan", b"1e999")

Files = dict[str, bytes]  # files for a reader: name → content; one file, or several in a folder


def _ply_files() -> dict[str, Files]:
    elements, forms = {"vertex": scene_file.ply_columns(random_scene(4, 1))}, scene_file.FORMATS
    files = {form: {"scene.ply": scene_file.ply_bytes(elements, form)} for form in forms}
    files["gzip"] = {"scene.ply.gz": gzip.compress(files["binary_little_endian"]["scene.ply"])}
    return files | {"compressed": {"scene.ply": scene_file.compressed_ply(300, 1)}}


SPZ = {f"spz {v}": {"scene.spz": spz_bytes(v, spz_codes(v, 40, 1), 1)} for v in (1, 2, 3, 4)}
SOG_IMAGES = {name: image_bytes(pixels) for name, pixels in sog_codes(6, 1, 3).items()}
SOG = {f"sog {v}": {"scene.sog": sog_bytes(sog_meta(v, 6, 1), SOG_IMAGES)} for v in (1, 2)}
SPZ_4 = {f"spz {v} of degree 4": {"scene.spz": spz_bytes(v, spz_codes(v, 9, 4), 4)} for v in (3, 4)}
KSPLAT = {f"ksplat {k}": {"scene.ksplat": small_ksplat(k, 2 * (k > 0))} for k in range(3)}
UNBUNDLED = {"meta.json": json.dumps(sog_meta(2, 6, 1)).encode()} | {
    f"{name}.webp": data for name, data in SOG_IMAGES.items()
}
LEAVES = [{"0": {"file": 0, "offset": 3 * k, "count": 3}} for k in range(2)]
STREAM = {
    "version": 1, "counts": [6, 0], "lodLevels": 2, "environment": "a.sog", "filenames": ["b.sog"],
    "tree": {"children": [{"lods": leaf} for leaf in LEAVES]},
}  # fmt: skip
STREAMED = {"lod-meta.json": json.dumps(STREAM).encode()} | {
    f"{name}.sog": SOG["sog 2"]["scene.sog"] for name in "ab"
}
FOLDERS = {"sog unbundled": UNBUNDLED, "sog streamed": STREAMED}
SPLAT = {"splat": {"scene.splat": scene_file.splat_bytes(5)}}


def _gltf() -> Builder:
    """Two nodes: Gaussians as float32 and as SPZ."""
    builder = Builder()
    builder.node(builder.primitive(random_scene(6, 1)), translation=[1, 2, 3])
    builder.node(builder.packed(SPZ["spz 4"]["scene.spz"]), scale=[2, 2, 2])
    return builder


GLTF = {"glb": {"scene.glb": _gltf().glb()}, "gltf": {"scene.gltf": _gltf().gltf()}}
SCENES = _ply_files() | SPZ | SPZ_4 | GLTF | SOG | FOLDERS | KSPLAT | SPLAT
CAMERAS = {
    "inria": {"cameras.json": json.dumps(inria()).encode()},
    "transforms": {"transforms.json": json.dumps(transforms()).encode()},
    "colmap text": colmap_text(),
    "colmap binary": colmap_binary(),
}
MODEL = pack(cloud(3, count=280, degree=3), quality="faithful")[0]
MODELS = {
    "model plain": {"a.splatcore": file_bytes(MODEL, plain=True)},
    "model coded": {"a.splatcore": encode(MODEL)},
}
FILES = SCENES | MODELS | CAMERAS
KINDS = [*FILES]


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Apply one to four mutations: flip a bit, cut the end off, insert or remove bytes, swap or
    repeat parts, put an extreme value into a field of the header or in place of a number.
    """
    for _ in range(rng.integers(1, 5)):
        size = max(len(data), 1)
        start, end = sorted(int(x) for x in rng.integers(0, size + 1, 2))
        part = data[start:end]
        match rng.integers(8):
            case 0:
                index = min(start, size - 1)
                flipped = bytes(byte ^ (1 << rng.integers(8)) for byte in data[index : index + 1])
                data = data[:index] + flipped + data[index + 1 :]
            case 1:
                data = data[:end]
            case 2:
                data = data[:start] + rng.bytes(int(rng.integers(1, 20))) + data[start:]
            case 3:
                data = data[:start] + data[start + int(rng.integers(1, 9)) :]
            case 4:
                data = data[end:] + part + data[:start]
            case 5:
                data = data[:end] + part + data[end:]
            case 6:
                offset = int(rng.integers(0, min(size, 120)))
                width = int(rng.choice([1, 2, 4, 8]))
                extreme = [bytes(width), b"\xff" * width, b"\xff" * (width - 1) + b"\x7f"]
                data = data[:offset] + extreme[rng.integers(3)] + data[offset + width :]
            case 7:
                words = data.split(b" ")
                words[rng.integers(len(words))] = ODD_NUMBERS[rng.integers(len(ODD_NUMBERS))]
                data = b" ".join(words)
    return data


def mutated_json(value: object, rng: np.random.Generator) -> object:
    """A copy with one value of the tree replaced or removed."""
    if not isinstance(value, dict | list) or not value or rng.random() < 0.1:
        return ODD_VALUES[rng.integers(len(ODD_VALUES))]
    copy = dict(value) if isinstance(value, dict) else dict(enumerate(value))
    key = [*copy][rng.integers(len(copy))]
    if rng.random() < 0.1:
        del copy[key]
    else:
        copy[key] = mutated_json(copy[key], rng)
    return copy if isinstance(value, dict) else [*copy.values()]


def mutated_files(kind: str, rng: np.random.Generator) -> Files:
    """Valid files of a kind, one of them mutated as stored or inside its gzip, zip or JSON."""
    files = dict(FILES[kind])
    name = [*files][rng.integers(len(files))]
    data, inside = files[name], rng.random() < 0.6
    if inside and kind in ("spz 1", "spz 2", "spz 3", "spz 3 of degree 4", "gzip"):
        data = gzip.compress(mutated(gzip.decompress(data), rng), compresslevel=1)
    elif inside and (name.endswith(".json") or kind == "gltf"):
        data = json.dumps(mutated_json(json.loads(data), rng)).encode()
    elif inside and kind == "glb":
        tree, binary = glb_parts(data)
        data = glb_bytes(mutated_json(tree, rng), binary)
    elif inside and kind in SOG:
        meta, images = sog_meta(int(kind[4]), 6, 1), dict(SOG_IMAGES)
        if rng.random() < 0.6:
            meta = mutated_json(meta, rng)
        else:
            image = [*images][rng.integers(len(images))]
            images[image] = mutated(images[image], rng)
        data = sog_bytes(meta, images)
    elif inside and kind == "model coded":
        data = encode(MODEL, lambda part: zstd(mutated(part, rng) if rng.random() < 0.03 else part))
    else:
        data = mutated(data, rng)
    return files | {name: data}


def check(kind: str, files: Files, folder: Path) -> str:
    """Read the files; return "read" or "refused" if result or message is sound."""
    for name, data in files.items():
        (folder / name).unlink(missing_ok=True)  # some file systems flush overwritten files
        (folder / name).write_bytes(data)
    path = folder if kind.startswith("colmap") else folder / next(iter(files))
    try:
        if kind in CAMERAS:
            assert all(isinstance(camera, Camera) for camera in read_cameras(path))
            return "read"
        if kind in MODELS:
            assert np.array_equal(read_model(path).image, MODEL.image)
            return "read"
        scene = read_scene(path)
    except InputError as error:
        assert str(error).startswith(str(folder)) and "\n" not in str(error)
        return "refused"
    count, coefficients = len(scene), (scene.sh_degree + 1) ** 2
    assert count >= 1 and scene.sh.shape == (count, coefficients, 3)
    assert scene.position.shape == scene.scale.shape == (count, 3)
    assert scene.quaternion.shape == (count, 4) and scene.opacity.shape == (count,)
    assert not (scene.scale < 0).any()
    assert not ((scene.opacity < 0) | (scene.opacity > 1)).any()
    return "read"


def attempt(index: int, seed: int, folder: Path) -> tuple[str, str]:
    """Run round `index` of the campaign `seed`; return kind of file and outcome."""
    rng = np.random.default_rng((seed, index))
    kind = KINDS[index % len(KINDS)]
    return kind, check(kind, mutated_files(kind, rng), folder)


@pytest.mark.parametrize("kind", KINDS)
def test_unmutated(tmp_path, kind):
    """The files that the campaign starts from are valid."""
    assert check(kind, FILES[kind], tmp_path) == "read"


MEMORY = 1 << 20
"""Bytes that reading a mutated file of at most 40 KB may take, without libraries' own."""


def enlarged(kind: str) -> Iterator[Files]:
    """The files of a kind with 2³¹ − 1 in place of four bytes of a header; then mutated files."""
    name = next(iter(FILES[kind]))
    data = FILES[kind][name]
    zipped = data.startswith(GZIP_MAGIC)
    data = gzip.decompress(data) if zipped else data
    for offset in (*range(0, 128, 4), *range(4096, 4160, 4)):  # the second for KSPLAT's section
        if offset + 4 <= len(data):
            changed = data[:offset] + b"\xff\xff\xff\x7f" + data[offset + 4 :]
            yield FILES[kind] | {name: gzip.compress(changed) if zipped else changed}
    for index in range(20):
        yield mutated_files(kind, np.random.default_rng((7, index)))


@pytest.mark.parametrize("kind", SCENES)
def test_memory(tmp_path, kind):
    """Sizes in a header take no memory that the file does not account for."""
    check(kind, FILES[kind], tmp_path)  # imports libraries
    tracemalloc.start()
    try:
        for number, files in enumerate(enlarged(kind)):
            tracemalloc.reset_peak()
            before, _ = tracemalloc.get_traced_memory()
            check(kind, files, tmp_path)
            _, peak = tracemalloc.get_traced_memory()
            assert peak - before < MEMORY, number
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.filterwarnings("error", "ignore::amaranth.hdl.UnusedElaboratable")
def test_mutated(tmp_path):
    """No reader breaks; of each kind some mutated files are read and some refused."""
    outcomes = Counter(attempt(index, 1, tmp_path) for index in range(ROUNDS))
    for kind in KINDS:
        assert outcomes[kind, "read"] and outcomes[kind, "refused"], kind


def main(rounds: int, seed: int) -> None:
    """Run a campaign: print each round's number as it starts, and at the end the outcomes'
    counts."""
    outcomes = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for index in range(rounds):
            print(f"\r{index}", end="", file=sys.stderr, flush=True)
            outcomes[attempt(index, seed, Path(folder))] += 1
    for (kind, outcome), count in sorted(outcomes.items()):
        print(f"{kind:22} {outcome:8} {count}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
