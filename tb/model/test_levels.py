"""Levels of detail in packed models: the tree, the merged Gaussians, damaged records."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.formats.model_file import decode, encode
from splatcore.model.generate.generate import generate
from splatcore.model.levels import merging
from splatcore.model.levels.build import SIZE, with_levels
from splatcore.model.pack.pack import pack
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.levels import LEVEL, groups, heights
from splatcore.spec.memory import CHUNK, chunk_count
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene
from tb.helpers.clouds import cloud
from tb.helpers.model_bits import with_checksum
from tb.helpers.refusal import refused


def packed(scene: Scene, quality: str | np.ndarray = "compact") -> tuple[PackedModel, PackedModel]:
    """A model without levels, and with them."""
    model, _ = pack(scene, DEFAULT, quality=quality)
    return model, with_levels(model, DEFAULT)[0]


@pytest.fixture(scope="module", params=["compact", "mixed", "small"])
def models(request) -> tuple[PackedModel, PackedModel]:
    """mixed: chunks with 1 to 4 beats per Gaussian"""
    if request.param == "mixed":
        return packed(cloud(2, 13 * CHUNK + 77, degree=3), np.arange(14) * 5 % len(LAYOUTS))
    return packed(generate("garden", 13 * CHUNK + 77), request.param)


def test_finest_level_is_the_model(models):
    """The same bits in the same order, and at most 2.2 times the bytes."""
    plain, model = models
    finest = heights(model.levels) == 0
    assert len(model) == len(plain) == plain.count < model.count
    assert len(model.image) <= 2.2 * len(plain.image)
    for field, codes in plain.chunks.items():
        assert np.array_equal(model.chunks[field][finest], codes), field
    for field in ("stored_positions", "stored_attributes", "sh"):
        same = getattr(plain.decoded(), field), getattr(model.decoded(), field)
        assert np.array_equal(*same), field
    assert np.array_equal(plain.gaussians().sh, model.gaussians().sh)


def test_coding_is_lossless(models):
    _, model = models
    assert np.array_equal(decode(encode(model), "model"), model.image)


@pytest.mark.parametrize("chunks", [0, 3, 4, 7, 15])
def test_tree(chunks):
    """Groups of two whole chunks each halve the level below, until one is left."""
    plain, model = packed(cloud(1, max(chunks * CHUNK - 19, 0), degree=0))
    level = np.bincount(heights(model.levels), minlength=1)
    expected, groups_left = [chunk_count(len(plain))], chunks // 4
    while groups_left:
        expected.append(2 * groups_left)
        groups_left //= 2
    assert level.tolist() == expected
    if chunks >= 4:
        assert [next(iter(groups(model.levels)))] == [(0, 2, level.sum())]  # the root has all


def test_spheres_and_errors(models):
    """A group's sphere holds the finest centres of its subtree; its error is at least theirs."""
    _, model = models
    levels, step = model.levels, 2.0 ** model.value("position_exponent")
    of = np.arange(model.count) // CHUNK
    position, finest = model.stored().position, np.repeat(levels["error"] == 0, CHUNK)
    found = list(groups(levels))
    assert len(found) == 4
    for start, end, jump in found:
        assert end == start + 2 and (levels["last"][start:end] == [0, 1]).all()
        centre = levels["centre"][start] * step
        own = position[(of >= end) & (of < jump) & finest[: model.count]]
        away = np.linalg.norm(own - centre, axis=1).max()
        assert away <= levels["radius"][start] < 2 * away + step
        assert levels["error"][start] >= levels["error"][end:jump].max()
        coarse = position[(of >= start) & (of < end)]
        assert (coarse >= own.min(0) - 1e-3).all() and (coarse <= own.max(0) + 1e-3).all()


def test_merging():
    """Gaussians merge within their group, and moments stay."""
    scene = cloud(5, 2 * (SIZE + 40), degree=1)
    weight, group = np.random.default_rng(0).uniform(1, 2, len(scene)), np.arange(len(scene)) // 552
    found, total, error = merging.coarser(scene, weight, group, SIZE)
    assert len(found) == 2 * SIZE and (error > 0).all()
    for k in range(2):
        own, new = group == k, slice(k * SIZE, (k + 1) * SIZE)
        assert np.isclose(weight[own].sum(), total[new].sum())
        means = weight[own] @ scene.position[own], total[new] @ found.position[new]
        assert np.allclose(*means)
    still = replace(scene, position=np.zeros_like(scene.position))
    assert (merging.coarser(still, weight, group, SIZE)[2] == 0).all()


def test_equal_places():
    """Gaussians at one place have an error above 0 all the same: finest chunks have 0."""
    scene = cloud(5, 4 * CHUNK, degree=0)
    _, model = packed(replace(scene, position=np.ones_like(scene.position)))
    assert (model.levels["error"] > 0).sum() == 2


def test_floaters_and_padding():
    """A floater's groups have large spheres; padding, of weight 0, merges too."""
    scene = cloud(5, 5 * CHUNK + 9, degree=0)
    scene.position[7] = 1e9
    plain, model = packed(scene)
    assert len(plain) > len(scene)
    assert np.isfinite(model.stored().position).all() and model.levels["radius"].max() > 1e4


def damaged(model: PackedModel, chunk: int, field: str, value: int):
    """The model with another code in a field of a chunk's record."""
    image = model.image.copy()
    place = model.layout.chunks + chunk * model.format.header_stride
    row = image[place : place + LEVEL.size].reshape(1, -1)
    codes = LEVEL.unpack(row)
    codes[field] = np.full_like(codes[field], value)
    image[place : place + LEVEL.size] = LEVEL.pack(codes)[0]
    return with_checksum(image, "model")


DAMAGE = [
    (2, "jump", 1, "jump of chunk 2 is not forward"),
    (2, "jump", 5000, "jump of chunk 2 is beyond the end, 22"),
    (2, "error", 0, "error of chunk 2 is not positive, but finer chunks follow"),
    (6, "error", 1, "jump of chunk 6 has no finer chunk"),
    (6, "last", 0, "last of chunk 6 is not set in a finest chunk"),
    (3, "last", 0, "last of chunk 3 is not set, but the next chunk is of another group"),
    (3, "radius", 0, "last of chunk 2 is not set, but the next chunk is of another group"),
    (7, "beats", 9, "beats of chunk 7 is not where `jump` begins"),
]


@pytest.fixture(scope="module")
def small() -> PackedModel:
    return packed(generate("garden", 13 * CHUNK + 77))[1]


@pytest.mark.parametrize(("chunk", "field", "value", "message"), DAMAGE)
def test_damage(small, chunk, field, value, message):
    refused(message, damaged, small, chunk, field, value)


def test_wrong_order(small):
    """Groups that overlap without one holding the other."""
    found = {start: jump for start, _, jump in groups(small.levels)}
    inner = max(start for start in found if found[start] < chunk_count(small.count))
    first = damaged(small, inner, "spare", 0).image
    assert len(first) == len(small.image)  # an unused field may have any value
    records = small.levels | {"jump": small.levels["jump"].copy()}
    records["jump"][inner : inner + 2] = found[inner] + 1
    from splatcore.spec.levels import fault

    beats = np.concatenate([[0], np.cumsum(small.chunk_beats)])
    records["beats"] = beats[records["jump"].astype(int)]
    field, why = fault(records, small.chunk_beats)
    assert field == "jump" and "group around it" in why


def test_refusals(small):
    refused("has levels of detail already", with_levels, small, DEFAULT)
    refused("preset PAPER renders no levels", with_levels, small, PAPER)
    refused("levels True needs positions", replace, PAPER, levels=True)
