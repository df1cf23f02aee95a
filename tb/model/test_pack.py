"""Packing: every bit against plain integers, dropped Gaussians, sizes, errors, damaged files."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.model.pack.codebook import quantise
from splatcore.model.pack.factor import largest_axis, lower_triangular
from splatcore.model.pack.pack import appearance, pack
from splatcore.model.pack.quality import INDEXED
from splatcore.sim.frame.metric import psnr
from splatcore.spec.colour import from_slopes, slopes_of
from splatcore.spec.config import DEFAULT, PAPER, PRESETS
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.error import InputError
from splatcore.spec.memory import CHUNK, CODEBOOK_MAX, COMPONENT, HEADER, SLOPE, model_format
from splatcore.spec.packed import PackedModel
from tb.helpers.clouds import camera, cloud
from tb.helpers.model_bits import aligned, bits, signed
from tb.helpers.refusal import refused

BYTES_MAX = 22


def half_float(code: int) -> float:
    """Decode FP16 without infinities: the highest exponent is one more binade."""
    exponent, fraction = code >> 10 & 31, code & 1023
    value = (fraction + 1024 * (exponent > 0)) * 2.0 ** (max(exponent, 1) - 25)
    return -value if code >> 15 else value


def plain_unpack(image: np.ndarray, n: int):
    """Decode Gaussian n of a DEFAULT model of degree 1, bit by bit as spec.memory documents it."""
    count, small = bits(image, 0, 64, 32), bits(image, 0, 63, 1)
    exponents = [signed(bits(image, 0, 128 + 16 * k, 16), 16) for k in range(4)]
    chunks = 64
    positions = chunks + aligned(32 * -(-count // 256))
    width = 27 if small else 45
    stored = count // 256 * 32 * width + -(-(count % 256) * width // 8)
    attributes = positions + aligned(stored)
    colours = attributes + aligned((8 if small else 16) * count)
    harmonics = colours + aligned((128 + 64) * 8)

    chunk, place = divmod(n, 256)
    head = chunks + 32 * chunk
    ends = [bits(image, head, 120 + 15 + 24 + 16 + 9 * k, 9) for k in range(7)]
    octant = sum(place >= end for end in ends)
    position = []
    for axis in range(3):
        origin = signed(bits(image, head, 40 * axis, 40), 40)
        shift = bits(image, head, 120 + 5 * axis, 5)
        part, at = width // 3, width * place + width // 3 * axis
        offset = bits(image, positions + 32 * width * chunk, at, part) << 15 - part
        offset += (octant >> axis & 1) << 15
        position.append((origin + (offset << shift)) * 2.0 ** exponents[0])

    if small:
        word, index = bits(image, attributes + 8 * n, 0, 64), 37
        unit, opacity = 2.0 ** ((word & 31) - 14), 2.0 ** (-(word >> 32 & 31) / 4)
        diagonal = [(word >> 5 + 4 * k & 15) * unit for k in range(3)]
        below = [word >> 17 + 5 * k & 31 for k in range(3)]
        l10, l20, l21 = ((-1) ** (code >> 4) * (code & 15) * unit for code in below)
    else:
        word, index = bits(image, attributes + 16 * n, 0, 128), 101
        diagonal = [half_float(word >> 15 * k & 0x7FFF) for k in range(3)]
        l10, l20, l21 = (half_float(word >> 45 + 16 * k & 0xFFFF) for k in range(3))
        opacity = 2.0 ** (-(word >> 93 & 255) / 32)
    take = lambda offset, width: word >> index + offset & (1 << width) - 1  # noqa: E731
    factor = np.array([[diagonal[0], 0, 0], [l10, diagonal[1], 0], [l20, l21, diagonal[2]]])
    entries = (take(0, 7), 128 + take(7, 6))
    colour = [
        sum(signed(bits(image, colours + 8 * e, 12 * k, 12), 12) for e in entries) for k in range(3)
    ]
    entries = (take(13, 7), 128 + take(20, 7))
    slopes = [
        sum(signed(bits(image, harmonics + 16 * e, 10 * k, 10), 10) for e in entries)
        for k in range(9)
    ]
    colour = np.array(colour) * 2.0 ** exponents[2]
    slopes = np.array(slopes).reshape(3, 3) * 2.0 ** exponents[3]
    return position, factor * 2.0 ** exponents[1], opacity, colour, slopes


@pytest.mark.parametrize("quality", INDEXED)
def test_every_bit_by_plain_integers(quality):
    model, _ = pack(cloud(1, count=700), quality=quality)
    gaussians = model.gaussians()
    assert 600 < len(model) < 700  # the transparent ones are dropped
    for n in range(len(model)):
        position, factor, opacity, colour, slopes = plain_unpack(model.image, n)
        assert list(gaussians.position[n]) == position
        assert (gaussians.factor[n] == factor).all()
        assert gaussians.opacity[n] == pytest.approx(opacity, rel=1e-15)
        shown = gaussians.sh[n, 0] * 0.28209479177387814 + 0.5
        np.testing.assert_allclose(shown, colour, atol=1e-14)
        direction = np.array([0.6, -0.64, 0.48])
        x, y, z = 0.4886025119029199 * direction
        sheen = -y * gaussians.sh[n, 1] + z * gaussians.sh[n, 2] - x * gaussians.sh[n, 3]
        np.testing.assert_allclose(slopes @ direction, sheen, atol=1e-14)


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("count", [0, 1, CHUNK, CHUNK + 1, 3000])
def test_close_to_the_scene(count, degree):
    scene = cloud(2, count=count, degree=degree)
    scene.opacity[:] = np.maximum(scene.opacity, 0.01)
    model, report = pack(scene)
    packed, order = model.gaussians(), match(scene.position, model.gaussians().position)
    assert len(packed) == report.packed == count
    assert sorted(order) == list(range(count))
    gaussians = scene.gaussians()
    lower = lower_triangular(gaussians.factor[order])
    scale = largest_axis(lower)[:, None, None]
    assert (np.abs(packed.factor - lower) <= scale * 2.0**-11).all()
    assert (np.abs(np.log2(packed.opacity / scene.opacity[order])) <= 2.0**-6 + 1e-12).all()
    assert report.position_error <= 1e-4
    if count:
        assert report.colour_rms < 0.05


def test_small_models_are_as_close_as_their_steps():
    """L within 1/15 of its largest element, opacities within 1/8 octave (1/4 at the end of their
    range), positions within 2^-10 of their chunk's span; colours as in a compact model."""
    scene = cloud(2, count=3000, degree=1)
    colours, slopes = appearance(scene.sh)
    books = quantise(colours, (7, 6), COMPONENT), quantise(slopes, (7, 7), SLOPE, largest=-3)
    found = {q: pack(scene, codebooks=books, quality=q)[0] for q in INDEXED}
    small, compact = (found[quality].gaussians() for quality in INDEXED)
    starts = np.arange(0, len(small), CHUNK)
    low, high = (f.reduceat(compact.position, starts) for f in (np.minimum, np.maximum))
    span = np.repeat(high - low, CHUNK, axis=0)[: len(small)]
    compact = compact[match(compact.position, small.position)]
    assert (np.abs(small.position - compact.position) <= span * 2.0**-9.99).all()
    off = np.abs(small.factor - compact.factor).max((1, 2))
    assert 0 < (off / np.abs(compact.factor).max((1, 2))).max() <= 1 / 15.5 + 2.0**-11
    off = np.abs(np.log2(small.opacity / compact.opacity))
    assert (off <= np.where(compact.opacity > 2**-7.75, 1 / 8 + 1 / 64, 1 / 4) + 1e-12).all()
    assert (small.sh == compact.sh).all()
    assert found["small"].bytes_per_gaussian < 11.6


@pytest.mark.parametrize("preset", (replace(DEFAULT, small_models=False), PAPER))
def test_small_models_for_machines_without_them(preset):
    with pytest.raises(InputError, match=r"preset .* renders compact.* models only"):
        pack(cloud(2, count=10, degree=1), preset, quality="small")


def test_layouts_for_machines_without_steps():
    with pytest.raises(InputError, match="preset PAPER renders compact models only"):
        pack(cloud(2, count=10, degree=1), PAPER, quality=np.zeros(1, int))


def match(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """For each point of b [M, 3] the index of the nearest point of a [N, 3]."""
    return np.array([np.argmin(((a - point) ** 2).sum(1)) for point in b], int)


def test_what_cannot_be_seen_is_dropped_and_counted():
    scene = cloud(3, count=40)
    scene.opacity[:] = 0.5
    scene.opacity[[3, 4, 5]] = np.nextafter(ALPHA_MIN, 0), 0.0, ALPHA_MIN
    scene.position[7, 0] = np.nan
    scene.scale[8, 1] = np.inf
    scene.quaternion[9, 2] = np.nan
    scene.sh[10, 3, 1] = -np.inf
    scene.opacity[11] = np.nan
    model, report = pack(scene)
    assert (report.not_finite, report.transparent, report.packed) == (5, 2, 33)
    assert len(model) == 33
    for array in (model.position, model.factor, model.opacity, model.sh):
        assert np.isfinite(array).all()


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("preset", PRESETS.values(), ids=lambda config: config.name)
def test_size(preset, degree):
    """Codebooks have the documented size, and models at most BYTES_MAX bytes per Gaussian."""
    model, report = pack(cloud(4, count=4000, degree=degree), preset)
    assert report.codebook_bytes == model_format(preset, degree).codebook_bytes <= CODEBOOK_MAX
    assert report.bytes == len(model.image)
    limit = BYTES_MAX + 0.2 if preset is PAPER else BYTES_MAX
    assert report.bytes_per_gaussian <= limit


def test_paper_stores_absolute_half_floats():
    scene = cloud(5, count=300)
    scene.position[:] += 100
    model, report = pack(scene, PAPER)
    expected = scene.position.astype(np.float16).astype(np.float64)
    kept = expected[scene.opacity >= ALPHA_MIN]
    assert {tuple(p) for p in model.position} == {tuple(p) for p in kept}
    assert report.position_error > 0.01


def test_degrees():
    scene = cloud(6, count=50, degree=3)
    assert pack(scene)[0].format.sh_degree == 1
    assert pack(scene, sh_degree=0)[0].format.sh_degree == 0
    assert pack(scene.with_sh_degree(0), sh_degree=1)[0].format.sh_degree == 0


def test_few_colours_are_kept_to_the_entry():
    """With no more distinct colours than entries, only the entries' rounding is lost."""
    scene = cloud(7, count=100)
    _, report = pack(scene)
    assert report.colour_rms < 2.0**-10


def test_stages_of_a_codebook():
    """Each further stage reduces the mean squared error at least threefold."""
    vectors = np.random.default_rng(0).normal(size=(5000, 3))
    errors = []
    for stages in ((4,), (4, 4), (4, 4, 4)):
        codebook = quantise(vectors, stages, COMPONENT)
        errors.append(((codebook.decode() - vectors) ** 2).mean())
        for entries, index, n in zip(codebook.entries, codebook.index, stages, strict=True):
            assert entries.shape == (1 << n, 3) and index.max() < 1 << n
            assert (entries == np.rint(entries)).all() and np.abs(entries).max() <= COMPONENT.max
    assert errors[2] < errors[1] / 3 < errors[0] / 9


def test_slopes_and_back():
    sh = np.random.default_rng(1).normal(size=(20, 3, 3))
    np.testing.assert_allclose(from_slopes(slopes_of(sh)), sh, atol=1e-15)


def test_needles_keep_their_thickness():
    """At axis ratio 1e6, Σ in float64 loses the thin axis; its factor L keeps it."""
    scene = cloud(8, count=200)
    scene.scale[:] = [1.0, 1e-6, 1e-6]
    factor = scene.gaussians().factor
    lower = lower_triangular(factor)
    assert (np.triu(lower, 1) == 0).all() and (np.diagonal(lower, axis1=1, axis2=2) >= 0).all()
    thin = np.linalg.svd(lower, compute_uv=False)[:, 1:]
    np.testing.assert_allclose(thin, 1e-6, rtol=1e-8)
    sigma = factor @ np.swapaxes(factor, 1, 2)
    np.testing.assert_allclose(lower @ np.swapaxes(lower, 1, 2), sigma, atol=1e-14)


def test_chunk_headers_are_bounds():
    """Headers bound positions and reach of their Gaussians, the reach within 1 %."""
    scene = cloud(9, count=10_000)
    model, _ = pack(scene)
    chunks, gaussians = model.chunks, model.gaussians()
    chunk = np.arange(len(model)) // CHUNK
    exponent = HEADER["position_exponent"].decode(model.header["position_exponent"])
    step = np.ldexp(1.0, int(exponent[0]))
    low = chunks["origin"][chunk] * step
    side = (chunks["extent"][chunk] + 1.0) * 256 * 2.0 ** chunks["shift"][chunk] * step
    assert (gaussians.position >= low).all() and (gaussians.position < low + side).all()
    sigma = np.linalg.svd(gaussians.factor, compute_uv=False)[:, 0]
    reach = sigma * np.sqrt(2 * np.log(255 * gaussians.opacity))
    assert (chunks["reach"][chunk] >= reach * (1 - 1e-12)).all()
    largest = np.maximum.reduceat(reach, np.arange(0, len(model), CHUNK))
    assert (chunks["reach"] <= 1.01 * largest).all()


def test_a_packed_model_renders_like_its_scene():
    scene = cloud(10, count=500)
    model, _ = pack(scene)
    both = (model.gaussians(), scene.gaussians())
    a, b = (render(each, camera(64, 48)).image.clip(0, 1) for each in both)
    assert psnr(a, b) > 30


def test_deterministic():
    assert (pack(cloud(11, count=1000))[0].image == pack(cloud(11, count=1000))[0].image).all()


def test_damaged_files_are_refused():
    image = pack(cloud(13, count=300))[0].image
    rng = np.random.default_rng(0)
    for length in [0, 1, 63, 64, 100, len(image) - 1]:
        with pytest.raises(InputError):
            PackedModel(image[:length], "cut")
    places = [*range(HEADER.width), *rng.integers(HEADER.width, 8 * len(image), 500)]
    for place in places:
        damaged = image.copy()
        damaged[place // 8] ^= 1 << place % 8
        refused(r"^flipped: [^\n]*$", PackedModel, damaged, "flipped")


def test_default_is_the_design_of_spec_memory():
    assert DEFAULT.colour_index[1] == (7, 6) and DEFAULT.sh_index[1] == (7, 7)
