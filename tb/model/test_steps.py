"""Models in steps: every bit against plain integers, errors per degree, layouts, bad headers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import sph_harm_y

from splatcore.model.pack.pack import pack
from splatcore.model.pack.steps import exponent_for, quantise
from splatcore.model.pack.stored import stored_scene
from splatcore.spec.colour import (
    COARSE,
    EXPONENT_MAX,
    EXPONENT_MIN,
    FINE,
    LAYOUTS,
    SECOND,
    folded,
    unfolded,
)
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.memory import CHUNK, CHUNK_HEADER, HEADER
from splatcore.spec.number import Fixed
from splatcore.spec.packed import PackedModel
from tb.helpers.clouds import cloud
from tb.helpers.model_bits import aligned, bits, signed, with_checksum
from tb.helpers.refusal import refused

BITS = {0: (), 1: (5, 5), 2: (3, 2, 3), 3: (5, 5, 6)}  # layout → bits per code, by degree
BEATS = {0: 0, 1: 1, 2: 1, 3: 2}  # layout → beats of harmonics per Gaussian
TERM_SIZES = ((3,), (3, 2), (3, 3, 1))  # polynomials of the terms of degrees 1, 2, 3


def plain_colours(image: np.ndarray) -> list[dict[int, np.ndarray]]:
    """Decode a model in steps, bit by bit as in the text of `spec`: factors by degree, per
    Gaussian."""
    count = bits(image, 0, 64, 32)
    exponents = [signed(bits(image, 0, 160 + 16 * k, 16), 16) for k in range(4)]
    positions = 64 + aligned(32 * -(-count // 256))
    beat = positions + aligned(count // 256 * 1440 + -(-(count % 256) * 45 // 8))
    found = []
    for n in range(count):
        header = 64 + 32 * (n // 256)
        layout = bits(image, header, 238, 2)
        s = [bits(image, header, 240 + 4 * d, 4) for d in range(4)]
        step = [
            (0.75 if code & 1 else 1) * 2.0 ** (e - code // 2)
            for code, e in zip(s, exponents, strict=True)
        ]
        base = [signed(bits(image, beat, 101 + 9 * k, 9), 9) for k in range(3)]
        factors = {0: np.array([base]) * step[0]}
        place, at = beat + 16, 2 * len(BITS[layout])
        for d, width in enumerate(BITS[layout], 1):
            shift = bits(image, beat + 16, 2 * (d - 1), 2)
            rows = []
            for size in TERM_SIZES[d - 1]:
                if at + 3 * size * width > 128:
                    place, at = place + 16, 0
                codes = [
                    signed(bits(image, place, at + k * width, width), width)
                    for k in range(3 * size)
                ]
                rows.append(np.array(codes).reshape(3, size).T)
                at += 3 * size * width
            factors[d] = (np.concatenate(rows) + (layout == 2) / 2) * step[d] / 2**shift
        found.append(factors)
        beat += 16 * (1 + BEATS[layout])
    return found


def mixed(count: int, degree: int, seed: int = 1):
    """A cloud whose chunks have all layouts in turn, and its model."""
    scene = cloud(seed, count=count, degree=degree)
    layouts = np.arange(-(-count // CHUNK)) % len(LAYOUTS)
    scene.opacity[:] = np.maximum(scene.opacity, 0.01)
    return scene, pack(scene, quality=layouts)[0]


def test_every_bit_by_plain_integers():
    _, model = mixed(5 * CHUNK + 3, 3)
    assert set(model.chunks["harmonics"]) == {0, 1, 2, 3}
    found = model.factors
    for n, factors in enumerate(plain_colours(model.image)):
        for d in range(4):
            expected = factors.get(d, np.zeros((2 * d + 1, 3)))
            assert (found[d][n] == expected).all(), (n, d)


def test_polynomials_are_the_harmonics():
    """Factors times polynomials of `spec.colour` equal scipy's real spherical harmonics."""
    rng = np.random.default_rng(0)
    x, y, z = direction = rng.normal(size=3)
    x, y, z = direction / np.linalg.norm(direction)
    polynomials = [
        [1],
        [y, z, x],
        [2 * x * y, 2 * y * z, (3 * z * z - 1) / 2, 2 * x * z, x * x - y * y],
        [
            y * (3 * x * x - y * y), 4 * x * y * z, y * (5 * z * z - 1), z * (5 * z * z - 3) / 2,
            x * (5 * z * z - 1), 2 * z * (x * x - y * y), x * (3 * y * y - x * x),
        ],
    ]  # fmt: skip
    sh = rng.normal(size=(1, 16, 3))
    for d, factors in enumerate(folded(sh)):
        expected = np.zeros(3)
        for m in range(-d, d + 1):
            value = sph_harm_y(d, abs(m), np.arccos(z), np.arctan2(y, x))
            part = value.real if m >= 0 else value.imag
            expected += sh[0, d * d + d + m] * part * (np.sqrt(2) if m else 1)
        np.testing.assert_allclose(np.array(polynomials[d]) @ factors[0], expected, atol=1e-12)
    np.testing.assert_allclose(unfolded(folded(sh)), sh, atol=1e-14)


@pytest.mark.parametrize(
    ("quality", "degree", "beats", "worst"),
    [
        ("faithful", 0, 1, ()), ("faithful", 1, 2, (0.06,)), ("faithful", 2, 2, (0.06, 0.06)),
        ("faithful", 3, 3, (0.06, 0.06, 0.03)), ("balanced", 3, 2, (0.25, 0.5, 0.25)),
    ],
)  # fmt: skip
def test_close_to_the_scene(quality, degree, beats, worst):
    """RMS errors of the factors per degree, relative to their RMS; sizes; errors in the report."""
    scene = cloud(2, count=3000, degree=degree)
    scene.opacity[:] = np.maximum(scene.opacity, 0.01)
    model, report = pack(scene, quality=quality)
    assert model.format.sh_degree == degree and report.codebook_bytes == 0
    assert (model.chunk_beats == beats).all()
    assert report.bytes_per_gaussian == pytest.approx(5.625 + 32 / CHUNK + 16 * beats, abs=0.05)
    sizes = [np.sqrt((f**2).mean()) for f in folded(scene.sh)]
    assert report.colour_rms < 0.002
    assert all(e <= w * s for e, w, s in zip(report.sh_rms, worst, sizes[1:], strict=True))
    exact = folded(stored_scene(scene, model.format).scene.sh)
    errors = [np.abs(a - b).max() for a, b in zip(model.factors, exact, strict=True)]
    assert [report.colour_error, *report.sh_error] == errors


def test_chunks_without_harmonics_have_no_beats_for_them():
    scene = cloud(3, count=4 * CHUNK, degree=3)
    scene.opacity[:] = 0.5
    first = scene.position[:, 0] < np.median(scene.position[:, 0])
    scene.sh[first, 1:] = 0
    scene.sh[~first, 9:] = 0
    model, _ = pack(scene, quality="faithful")
    used = [LAYOUTS[k].degree for k in model.chunks["harmonics"]]
    assert max(used) == 2 and model.format.sh_degree == 3
    only = scene[first]
    assert (pack(only, quality="faithful")[0].chunk_beats == 1).all()
    only.sh[9, 12, 1] = 1e-4  # one coefficient of one Gaussian is enough
    assert sorted(pack(only, quality="faithful")[0].chunk_beats) == [1, 3]


def test_layouts_side_by_side():
    """A chunk decodes alike, whatever layouts the other chunks have."""
    scene, model = mixed(5 * CHUNK + 3, 3)
    layout = np.repeat(model.chunks["harmonics"], CHUNK)[: len(model)]
    for number in range(len(LAYOUTS)):
        alone, _ = pack(scene, quality=np.full(len(model.chunk_beats), number))
        for found, expected in zip(model.factors, alone.factors, strict=True):
            assert (found[layout == number] == expected[layout == number]).all(), number


def test_a_coefficient_a_thousand_times_the_others():
    """The outlier keeps to its chunk's step; the others get steps eight times finer."""
    scene = cloud(4, count=CHUNK, degree=3)
    scene.opacity[:] = 0.5
    scene.sh[:, 1:] *= 0.01 / np.abs(scene.sh[:, 1:]).max()
    scene.sh[7, 9, 1] = 10.0
    model, _ = pack(scene, quality="faithful")
    at = np.argmax(np.abs(model.sh[:, 9, 1]))
    assert abs(model.sh[at, 9, 1] - 10) < 0.3
    others = np.delete(model.sh, at, axis=0)
    assert np.abs(others[:, 9:]).max() < 0.06  # half a step, eight times finer


def test_steps_are_those_of_the_least_error():
    """Against trying all steps of a chunk and all shifts of its Gaussians, one by one."""
    rng = np.random.default_rng(0)
    factors = rng.normal(size=(12, 3, 3)) * 2.0 ** rng.uniform(-7, 0, (12, 1, 1))
    of = np.repeat([0, 1], [7, 5])
    for width, halves, shifts in ((5, False, 4), (3, True, 4), (9, False, 1)):
        code = Fixed(width - 1, 0, signed=True)
        exponent = exponent_for(factors, code)
        codes, s, own = quantise(factors, of, code, exponent, halves, shifts)
        ends, half = (-(1 << width - 1), (1 << width - 1) - 1), halves / 2
        assert codes.min() >= ends[0] and codes.max() <= ends[1]

        def errors(level, ends=ends, half=half, exponent=exponent):
            """Squared error per Gaussian, with the nearest codes at step number `level`."""
            size = (0.75 if level & 1 else 1) * 2.0 ** (exponent - level // 2)
            near = np.clip(np.floor(factors / size - half + 0.5), *ends) + half
            return ((near * size - factors) ** 2).sum((1, 2))

        tried = np.array([[errors(s + 2 * g) for g in range(shifts)] for s in range(16)])
        least = np.stack([tried.min(1)[:, of == c].sum(1) for c in (0, 1)])
        np.testing.assert_allclose(least[[0, 1], s], least.min(1), rtol=1e-9)
        size = np.where(s & 1, 0.75, 1) * 2.0 ** (exponent - s // 2)
        made = (codes + half) * (size[of] / 2.0**own)[:, None, None]
        error = ((made - factors) ** 2).sum((1, 2))
        np.testing.assert_allclose(error, tried.min(1)[s[of], np.arange(12)], rtol=1e-9)


@pytest.mark.parametrize("width", [2, 5, 9])
def test_exponents_are_the_least_that_hold_the_largest(width):
    code = Fixed(width - 1, 0, signed=True)
    top = (1 << width - 1) - 1
    for size in (top - 0.01, top + 0.01):
        for exponent in (-12, 0, 3):
            found = exponent_for(np.full((4, 1, 3), size * 2.0**exponent), code)
            assert found == exponent + (size > top)
    assert exponent_for(np.full((1, 1, 3), 1e6), code) == EXPONENT_MAX


def test_nothing_has_the_finest_steps():
    """Half-step codes have no zero, so a degree without harmonics keeps a negligible error."""
    scene = cloud(5, count=CHUNK, degree=3)
    scene.opacity[:] = 0.5
    scene.sh[:, 1:9] = 0
    model, report = pack(scene, quality="balanced")
    assert model.exponents[1:3] == [EXPONENT_MIN] * 2
    assert 0 < max(report.sh_error[:2]) < 2.0**-20


def test_machines_and_qualities():
    scene = cloud(6, count=50, degree=3)
    for degree in range(4):
        config = replace(DEFAULT, sh_degree=degree)
        assert pack(scene, config, quality="faithful")[0].format.sh_degree == degree
        assert pack(scene, config)[0].format.sh_degree == min(degree, 1)
    refused("PAPER renders compact models only", pack, scene, PAPER, quality="faithful")


def edited(image: np.ndarray, offset: int, width: int, value: int) -> PackedModel:
    """The model with `value` in its bits from `offset` on, and a matching checksum."""
    bits_ = np.unpackbits(image, bitorder="little")
    bits_[offset : offset + width] = [value >> k & 1 for k in range(width)]
    return with_checksum(np.packbits(bits_, bitorder="little"), "odd")


CHUNK_AT = 8 * 64  # bit at which chunk headers begin
EDITS = {
    "version": (HEADER.offset("version"), 16, 2, r"version 2 is not 3 or 4 or 5; repack"),
    "unmarked": (HEADER.offset("version"), 16, 4, "antialiased does not go with version 4"),
    "marked": (HEADER.offset("antialiased"), 1, 1, "antialiased does not go with version 3"),
    "degree": (HEADER.offset("sh_degree"), 8, 4, "sh_degree 4 is not in 0 … 3"),
    "exponent": (HEADER.offset("exponent") + 16, 16, 5, "exponent"),
    "low exponent": (HEADER.offset("exponent") + 32, 16, (1 << 16) - 16, "exponent"),
    "codebooks": (HEADER.offset("colour_index"), 8, 7, "colour_index names codebooks"),
    "sh codebook": (HEADER.offset("sh_index"), 8, 7, "sh_index does not go with"),
    "layout": (CHUNK_AT + CHUNK_HEADER.offset("harmonics"), 2, SECOND, "needs"),
    "count": (HEADER.offset("count"), 32, 1 << 30, "beyond the file's end"),
}  # fmt: skip


@pytest.mark.parametrize("name", EDITS)
def test_headers_that_contradict_themselves_are_refused(name):
    *edit, message = EDITS[name]
    model, _ = pack(cloud(13, count=300, degree=3), quality="faithful")
    refused(f"^odd: .*{message}", edited, model.image, *edit)


def test_halves_need_all_their_degrees():
    """COARSE stores degree 3 in half-step codes without a zero: not for a model of degree 2."""
    scene = cloud(14, count=300, degree=3)
    model, _ = pack(scene, quality=np.full(2, COARSE))
    message = "harmonics 2 of a chunk does not go with SH degree 2"
    refused(message, edited, model.image, HEADER.offset("sh_degree"), 8, 2)
    for kind in (COARSE, FINE):
        flat, _ = pack(scene.with_sh_degree(2), quality=np.full(2, kind))
        assert set(flat.chunks["harmonics"]) == {SECOND}
