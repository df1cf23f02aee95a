"""Model files: coding is lossless, broken files are refused before they take much memory."""

import tracemalloc

import numpy as np
import pytest
import zstandard

from splatcore.model.formats.model_file import (
    decode,
    encode,
    file_bytes,
    is_packed,
    read_model,
    zstd,
)
from splatcore.model.pack.pack import pack
from splatcore.spec import coded
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.error import InputError
from splatcore.spec.memory import HEADER, chunk_count
from splatcore.spec.packed import PackedModel
from tb.helpers.clouds import cloud
from tb.helpers.model_bits import with_checksum
from tb.helpers.refusal import refused as check_refused

BEGIN = coded.FILE_HEADER.size + HEADER.size
WAYS = [
    ("small", 0),
    ("small", 1),
    ("compact", 0),
    ("compact", 1),
    ("balanced", 3),
    *(("faithful", d) for d in range(4)),
]
COUNTS = (0, 1, 255, 256, 257, 600)


def model(count: int = 1000, degree: int = 3, quality="faithful", config=DEFAULT) -> PackedModel:
    return pack(cloud(7, count=count, degree=degree), config, quality=quality)[0]


def palette(count: int = 600) -> PackedModel:
    """A model whose Gaussians share five sets of harmonics."""
    scene = cloud(8, count=count, degree=3)
    scene.sh[:] = scene.sh[np.random.default_rng(0).integers(0, 5, count)]
    return pack(scene, quality="faithful")[0]


def same(found: np.ndarray, expected: PackedModel) -> bool:
    return found.dtype == np.uint8 and np.array_equal(found, expected.image)


@pytest.mark.parametrize("quality, degree", WAYS)
@pytest.mark.parametrize("count", COUNTS)
def test_every_bit_comes_back(count, quality, degree):
    packed = model(count, degree, quality)
    for switches in ({}, {"differences": False}, {"repeats": False}):
        assert same(decode(encode(packed, **switches), "m"), packed)


@pytest.mark.parametrize("seed", range(5))
def test_mixed_chunks(seed):
    """Chunks with and without harmonics, of all layouts, in one model."""
    rng, count = np.random.default_rng(seed), 1500
    packed = model(count, 3, rng.integers(0, 4, chunk_count(count)))
    assert len(set(packed.chunks["harmonics"])) > 1
    assert same(decode(encode(packed), "m"), packed)


def test_absolute_positions():
    packed = model(300, 1, "compact", PAPER)
    assert packed.format.position == "absolute"
    assert same(decode(encode(packed), "m"), packed)


def test_files(tmp_path):
    """The smaller of the coded and the plain file is written; both kinds are read."""
    for packed, small in ((model(), True), (palette(), True), (model(0), False)):
        for plain in (False, True):
            path = tmp_path / "m.splatcore"
            path.write_bytes(file_bytes(packed, plain))
            assert is_packed(path) and same(read_model(path).image, packed)
            start = path.read_bytes()[:4]
            assert start == (b"SPLZ" if small and not plain else b"SPLT")
            assert (path.stat().st_size < len(packed.image)) == (start == b"SPLZ")
    assert not is_packed(tmp_path / "none")
    check_refused("none", read_model, tmp_path / "none")


def test_bytes_between_parts():
    """A model with padding bytes that are not zero is stored plain, so that none is lost."""
    packed = model(1001)
    image, layout = packed.image.copy(), packed.layout
    assert layout.colours - layout.attributes > len(packed) * 3 * 16
    image[layout.colours - 1] = 1
    odd = with_checksum(image, "m")
    assert file_bytes(odd) == odd.image.tobytes()


def plain_columns(data: bytes) -> list[tuple[int, int, list[int]]]:
    """Decode the columns of a compact model by plain integers, with the widths of `spec.memory`;
    return (back, previous, stored codes) per column."""
    chunk = [40] * 3 + [5] * 3 + [8] * 3 + [16] + [9] * 7 + [2] + [4] * 4
    attribute = [15] * 3 + [16] * 3 + [8, 7, 6, 7, 7]
    found, at = [], 70
    for width in (*chunk, 15, 15, 15, *attribute, 11, 11, 11, 28, *[9] * 9, 38):
        about, at, codes = data[at], at + 1, None
        for k in range(-(-width // 8)):
            size = int.from_bytes(data[at : at + 4], "little")
            part = zstandard.decompress(data[at + 4 : at + 4 + size])
            at += 4 + size
            codes = [c + (b << 8 * k) for c, b in zip(codes or [0] * len(part), part, strict=True)]
        found.append((about & 127, about >> 7, codes))
    assert at == len(data)
    return found


def test_columns_as_documented():
    """A decoder written from the documentation alone finds the model's codes."""
    packed = model(700, 1, "compact")
    found = plain_columns(encode(packed))
    widths = {22: 15, 23: 15, 24: 15, 31: 8, 32: 7}  # x, y, z, opacity, the first of colours
    expected = [*packed.stored_positions.T, *(packed.attributes[f] for f in ("opacity", "colour0"))]
    assert any(previous for _, previous, _ in found) and any(back for back, *_ in found)
    for (number, width), codes in zip(widths.items(), expected, strict=True):
        back, previous, stored = found[number]
        other = expected[number - back - 22] if back else np.zeros(len(codes), int)
        change = [int(c) - int(o) for c, o in zip(codes, other, strict=True)]
        for n, code in enumerate(stored):
            before = change[n - 1] if previous and n else 0
            assert code == (change[n] - before) % (1 << width)


def test_differences_and_sums():
    """summed() inverts difference(), for all widths and predictions."""
    rng = np.random.default_rng(1)
    for width in (1, 5, 8, 9, 16, 17, 40, 64):
        top = (1 << width) - 1
        columns = [rng.integers(0, top, 50, np.uint64, endpoint=True) for _ in range(4)]
        columns = [column.astype(coded.code_dtype(width)) for column in columns]
        for back in range(4):
            for previous in (0, 1):
                stored = coded.difference(columns, 3, width, back, previous)
                assert stored.max() <= top
                found = coded.summed(stored, columns[:3], width, back, previous)
                assert found.dtype == columns[3].dtype and (found == columns[3]).all()


def test_copies_of_rows():
    """distances() finds repeated rows, places() restores them; bad distances give None."""
    rows = np.array([[1, 2], [3, 4], [1, 2], [1, 2], [5, 6], [3, 4], [5, 6]], np.uint8)
    distance, stored = coded.distances(rows)
    assert distance.tolist() == [0, 0, 2, 2, 0, 2, 1]
    assert stored.tolist() == [[1, 2], [3, 4], [5, 6]]
    assert (stored[coded.places(distance)] == rows).all()
    assert coded.places(np.array([0, 2], np.uint32)) is None
    assert coded.places(np.array([1, 0], np.uint32)) is None


def test_copies_and_differences_make_files_smaller():
    packed, grey = palette(), cloud(8, count=600, degree=3)
    assert len(encode(packed)) < 0.7 * len(encode(packed, repeats=False))
    grey.sh[:] = grey.sh[..., :1]
    packed = pack(grey, quality="faithful")[0]
    assert len(encode(packed)) < 0.7 * len(encode(packed, differences=False))


def refused(data: bytes, expected: PackedModel) -> str:
    """The message if a file is refused; "" if it still decodes to the expected model."""
    try:
        found = PackedModel(decode(data, "a.splatcore"), "a.splatcore")
    except InputError as error:
        assert str(error).startswith("a.splatcore: ") and "\n" not in str(error)
        return str(error)
    assert same(found.image, expected)
    return ""


def test_cut_files():
    packed = palette(300)
    data = encode(packed)
    for length in (*range(0, 300), *range(300, len(data), 97), len(data) - 1):
        assert refused(data[:length], packed)
    assert "header is cut off: 69 bytes, not 70" in refused(data[:69], packed)
    assert "sh" not in refused(data[:-1], packed)  # a model in steps has no such table
    assert "follow the last column" in refused(data + b"\0", packed)


@pytest.mark.parametrize("quality", ("small", "compact", "faithful"))
def test_flipped_bits(quality):
    """Any flipped bit is refused or harmless; in the headers it is always refused."""
    packed = model(300, 1, quality)
    data, rng = encode(packed), np.random.default_rng(2)
    places = [*range(8 * BEGIN), *rng.integers(8 * BEGIN, 8 * len(data), 200)]
    for place in places:
        damaged = bytearray(data)
        damaged[place // 8] ^= 1 << place % 8
        if place >= 32:  # without its magic number it is another kind of file
            assert refused(bytes(damaged), packed) or place >= 8 * BEGIN


def with_field(data: bytes, field: str, value: int) -> bytes:
    at, size = coded.FILE_HEADER.size + HEADER.offset(field) // 8, HEADER[field].width // 8
    return data[:at] + value.to_bytes(size, "little") + data[at + size :]


def test_sizes_are_checked_before_memory_is_taken():
    packed = model(300, 1, "compact")
    data, most = encode(packed), (1 << 32) - 1
    bomb = zstandard.compress(bytes(1 << 28), 1)
    column = lambda frame: data[: BEGIN + 1] + len(frame).to_bytes(4, "little") + frame  # noqa: E731
    sizeless = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(2))
    broken = {
        "end: claims": with_field(data, "end", most),
        "count 4294967295 needs more": with_field(data, "count", most),
        "does not match 0 beats": with_field(data, "end", packed.value("end") + 1),
        "chunks column 0 byte 0: claims 268435456 bytes, not 2": column(bomb),
        "chunks column 0 byte 0: claims -1 bytes, not 2": column(sizeless),
        "chunks column 0 byte 0: is not a zstd frame": column(zstd(bytes(2))[:-1]),
        "chunks column 0: refers to a wrong column, 1 before": data[:BEGIN]
        + b"\1"
        + data[BEGIN + 1 :],
        "bytes, only": data[: BEGIN + 1] + b"\xff" * 4 + data[BEGIN + 5 :],
        "file version 2 is not 1": data[:4] + b"\2" + data[5:],
    }
    for message, file in broken.items():
        tracemalloc.start()
        assert message in refused(file, packed)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20, message
        tracemalloc.stop()


def test_extra_bytes_in_a_frame():
    packed = model(300, 1, "compact")
    data = encode(packed, lambda part: zstd(part) + b"\0")
    assert "chunks column 0 byte 0: is not a zstd frame" in refused(data, packed)


def test_distances_beyond_the_first_row():
    packed = palette(300)

    def compress(part: bytes) -> bytes:
        """Replace each byte 1 by 201, so that distances point before the first row."""
        return zstd(bytes(byte + 200 if byte == 1 else byte for byte in part))

    assert "distance: points before the first row" in refused(encode(packed, compress), packed)


def test_models_that_would_expand_too_much_stay_plain():
    scene = cloud(9, count=1, degree=0)
    packed = pack(scene[np.zeros(300_000, int)], quality="faithful")[0]
    assert len(packed.image) > 1032 * len(encode(packed))
    assert file_bytes(packed) == packed.image.tobytes()
