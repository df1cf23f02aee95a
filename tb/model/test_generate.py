"""Generated scenes: the garden's shapes, light and statistics, the registry of all scenes; every
hard case of antialiased scenes really has the property that makes it hard."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import project, render
from splatcore.model.generate import garden_light
from splatcore.model.generate import generate as scenes
from splatcore.model.generate.directions import UP, frames, random_directions
from splatcore.model.generate.garden_light import SUN, projected_area
from splatcore.model.generate.garden_splats import quaternions, refine, share_out, splats
from splatcore.model.generate.generate import PARTS, garden, generate, generated_camera
from splatcore.model.generate.hard import HARD, HardCase
from splatcore.model.generate.hard_colour import ANTIALIASED
from splatcore.spec import scene as spec_scene
from splatcore.spec.camera import look_at
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.scene import ARRAYS, rotation_matrix
from tb.helpers.refusal import refused


def part_of(scene, name):
    """The Gaussians of one part of a garden."""
    counts = scenes.part_counts(len(scene))
    start = sum(list(counts.values())[: list(counts).index(name)])
    return scene[start : start + counts[name]]


@pytest.mark.parametrize("count", [1, 2, 7, 13, 100, 1_234, 20_000, 70_001])
def test_count_and_contract(count):
    """Exactly `count` Gaussians, all finite, positive and normalised."""
    scene = garden(count)
    assert len(scene) == count and scene.sh_degree == 1
    for name in ARRAYS:
        array = getattr(scene, name)
        assert array.dtype == np.float64 and np.isfinite(array).all(), name
    assert (scene.scale > 0).all() and (scene.opacity > 0).all() and (scene.opacity <= 1).all()
    assert np.allclose(np.linalg.norm(scene.quaternion, axis=1), 1, atol=1e-12)


def test_every_part_alone_gives_its_count():
    for name, (build, _) in PARTS.items():
        for count in (1, 2, 3, 5, 17, 64, 301):
            assert len(build(np.random.default_rng([0, 1]), count)) == count, name


def test_deterministic():
    first, again, other = garden(3_000, 5), garden(3_000, 5), garden(3_000, 6)
    for name in ARRAYS:
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
        assert not np.array_equal(getattr(first, name), getattr(other, name)), name


def test_degrees():
    """Degrees 0 and 1 are the same light; those above are small, smaller with the degree, random by
    the seed, none in the sky, and do not change the rest."""
    plain, none, second, third = (garden(3_000, 5, degree) for degree in (1, 0, 2, 3))
    assert np.array_equal(none.sh, plain.sh[:, :1]) and none.sh.dtype == np.float64
    for name in ARRAYS[:4]:
        assert np.array_equal(getattr(third, name), getattr(plain, name)), name
    for scene, count in ((second, 9), (third, 16)):
        assert scene.sh.shape == (3_000, count, 3) and scene.sh.dtype == np.float32
        assert np.array_equal(scene.sh[:, :4], plain.sh.astype(np.float32))
    assert not part_of(third, "sky").sh[:, 4:].any()
    grass = part_of(third, "grass").sh
    assert (grass[:, 4:] != 0).all()
    assert 0.02 < grass[:, 4:9].std() < 0.04 and 0.01 < grass[:, 9:].std() < 0.02
    assert np.array_equal(third.sh, garden(3_000, 5, 3).sh)
    assert not np.array_equal(grass[:, 4:], part_of(garden(3_000, 6, 3), "grass").sh[:, 4:])
    assert not np.array_equal(grass[:, 4:], third.sh[len(grass) : 2 * len(grass), 4:])


def test_degrees_do_not_depend_on_batches(monkeypatch):
    whole = garden(3_000, 1, 3)
    monkeypatch.setattr(spec_scene, "BATCH", 100)
    parts = garden(3_000, 1, 3)
    for name in ARRAYS:
        assert np.array_equal(getattr(whole, name), getattr(parts, name)), name


def test_all_parts_keep_their_share():
    for count in (100, 5_000, 200_000):
        counts = scenes.part_counts(count)
        assert sum(counts.values()) == count and all(counts.values())
        for name, (_, share) in PARTS.items():
            total = sum(s for _, s in PARTS.values())
            assert abs(counts[name] - count * share / total) <= 1, name


def test_share_out():
    assert share_out(10, [1, 1, 1]).tolist() == [4, 3, 3]
    assert share_out(1, [0.2, 0.5, 0.3]).tolist() == [0, 1, 0]
    assert share_out(0, [1, 2]).tolist() == [0, 0]


def test_scales_shrink_with_the_count():
    """With four times the splats on a surface, each is about half as large."""
    coarse, fine = garden(8_000), garden(32_000)
    for name in ("ground", "path", "bird_bath", "tree", "sky"):
        sizes = [np.median(np.sort(part_of(s, name).scale)[:, 1]) for s in (coarse, fine)]
        assert 1.4 < sizes[0] / sizes[1] < 2.6, name


def test_frame_of_the_scene():
    """y points down: ground near y = 0, objects at negative y and close, the sky far away."""
    scene = garden()
    ground = part_of(scene, "ground").position
    near = np.linalg.norm(ground, axis=1) < 6
    assert np.abs(ground[near, 1]).max() < 0.12
    for name, height in (("tree", 2.0), ("bench", 0.7), ("bird_bath", 0.7), ("fence", 0.8)):
        y = part_of(scene, name).position[:, 1]
        assert -1.8 * height < y.min() < -height and y.max() < 0.15, name
    for name in ("tree", "bench", "bird_bath"):
        assert np.linalg.norm(part_of(scene, name).position, axis=1).max() < 5, name
    assert np.linalg.norm(part_of(scene, "sky").position, axis=1).min() > 80


def test_statistics_like_a_trained_scene():
    scene = garden()
    ratio = scene.scale.max(axis=1) / scene.scale.min(axis=1)
    assert np.median(ratio) > 5 and ratio.max() > 20
    assert 0.35 < np.mean(scene.opacity > 0.85) < 0.7
    assert 0.005 < np.mean(scene.opacity < 0.2) < 0.1
    leafy = part_of(scene, "tree").opacity
    assert 0.2 < np.mean((leafy > 0.2) & (leafy < 0.7)) < 0.6


def test_sheen():
    """Glossy parts have degree-1 SH, sky and soil none; water is brighter towards the sun."""
    scene = garden()
    assert not part_of(scene, "sky").sh[:, 1:].any()
    water = part_of(scene, "bird_bath")[-60:]
    leaf, soil = part_of(scene, "tree"), part_of(scene, "ground")
    strength = [np.abs(s.sh[:, 1:]).mean() for s in (water, leaf, soil)]
    assert strength[0] > 2 * strength[1] > 0 and strength[2] == 0
    mirror = SUN * [-1, 1, -1]  # direction of the sun's reflection in level water
    d = -mirror  # from the viewer to the water; basis (−y, z, −x)
    gain = np.einsum("a,nac->nc", [-d[1], d[2], -d[0]], water.sh[:, 1:]) * 0.4886
    assert 0.05 < gain.mean() < 0.5


@pytest.mark.parametrize("count, bound", [(2_000, 0.1), (20_000, 0.1), (60_000, 0.15)])
def test_no_holes(count, bound):
    """Ground and sky cover every pixel, in all directions from the camera."""
    gaussians = garden(count).gaussians()
    camera = scenes.garden_camera(96, 54)
    frame = render(gaussians, camera)
    assert frame.transmittance.max() < bound
    assert frame.image.mean(axis=2).min() > 0.03
    eye = camera.position
    for target in ([4, -2.2, 0], [-9, -2, -6], [0, -2, -20], [1, -9, 1]):
        around = look_at(eye, eye + np.array(target) + [0, 1.4, 0], 64, 36, 58)
        assert render(gaussians, around).transmittance.max() < bound, target


def test_the_picture():
    """The garden's camera shows a blue sky above green ground, with poppies and marigolds."""
    image = np.clip(render(garden(20_000).gaussians(), scenes.garden_camera(240, 135)).image, 0, 1)
    red, green, blue = np.moveaxis(image, 2, 0)
    top, bottom = slice(0, 20), slice(100, 135)
    assert blue[top, 120:].mean() > red[top, 120:].mean() + 0.05
    assert green[bottom].mean() > blue[bottom].mean() + 0.1
    assert np.sum((red > 0.6) & (green < 0.35) & (blue < 0.35)) > 15  # poppies
    assert np.sum((red > 0.7) & (green > 0.6) & (blue < 0.35)) > 15  # marigolds
    assert image.std() > 0.15


def test_quaternions_of_frames():
    rng = np.random.default_rng(1)
    frame = frames(random_directions(rng, 500), random_directions(rng, 500))
    half_turns = np.array([np.diag(d) for d in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1, 1, 1])])
    frame = np.concatenate([frame, half_turns])
    assert np.allclose(np.linalg.det(frame), 1)
    assert np.allclose(rotation_matrix(quaternions(frame)), frame, atol=1e-12)


def test_refine_keeps_the_shape():
    """Splitting a Gaussian gives the wanted count and keeps the extent of the whole."""
    rng = np.random.default_rng(2)
    frame = frames(random_directions(rng, 1), random_directions(rng, 1))
    one = splats(np.zeros((1, 3)), np.array([0.5, 0.2, 0.05]), frame, 0.8, np.full(3, 0.5))
    many = refine(rng, one, 4_000)
    assert len(many) == 4_000 and len(refine(rng, many, 17)) == 17
    local = many.position @ frame[0]
    spread = np.sqrt(local.var(axis=0) + many.scale[0] ** 2)
    assert np.allclose(spread, one.scale[0], rtol=0.2)


def test_shadow():
    """Below an opaque sheet it is dark; next to the sheet and above it, it is not."""
    rng = np.random.default_rng(3)
    x, z = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))
    sheet = np.stack([x.ravel(), -1 + rng.uniform(-0.03, 0.03, x.size), z.ravel()], axis=1)
    probes = np.array([[0, -0.2, 0], [3, -0.2, 0], [0, -2.0, 0]])
    position = np.concatenate([sheet, probes])
    aim = frames(np.tile(UP, (len(position), 1)), random_directions(rng, len(position)))
    part = splats(position, np.array([0.05, 0.05, 0.002]), aim, 0.9, np.full(3, 0.5), leafy=0.0)
    light = garden_light.transmittance(part, UP, cell=0.2, bias=0.1)
    assert light[-3] < 0.02 and np.allclose(light[-2:], 1)
    clear = np.hypot(sheet[:, 0], sheet[:, 2]) > 0.5  # outside the third probe's shadow
    assert np.allclose(light[: x.size][clear], 1)  # no splat shades itself
    shown = garden_light.sh_coefficients(part)[:, 0]
    assert (shown[-3] < shown[-2] - 0.2).all()


def test_projected_area():
    """Area from the formula against the determinant of the projected covariance."""
    rng = np.random.default_rng(4)
    aim = frames(random_directions(rng, 50), random_directions(rng, 50))
    scale = np.exp(rng.uniform(-4, 0, (50, 3)))
    part = splats(np.zeros((50, 3)), scale, aim, rng.uniform(0, 1, 50), np.full(3, 0.5))
    plane = frames(SUN[None], UP)[0, :, :2]  # [3, 2]
    factor = np.einsum("ip,nij->npj", plane, aim * scale[:, None, :])
    root = np.sqrt(np.linalg.det(factor @ factor.transpose(0, 2, 1)))
    assert np.allclose(projected_area(part, SUN), 2 * np.pi * part.opacity * root)


def test_registry():
    assert set(scenes.GENERATORS) == {"garden", *HARD}
    for name in scenes.GENERATORS:
        assert generate(name).name == name
        assert generated_camera(name).name == name
    assert len(generate("garden")) == scenes.GARDEN_COUNT
    assert len(generate("garden", 321)) == 321
    assert not np.array_equal(generate("needles", seed=1).sh, generate("needles", seed=2).sh)


def test_generated_camera_sizes():
    own = generated_camera("garden")
    assert (own.width, own.height) == (960, 540)
    small = generated_camera("garden", 96, 54)
    assert (small.width, small.height) == (96, 54)
    assert small.tan_half_fov == pytest.approx(own.tan_half_fov)
    wide = generated_camera("needles", width=128)
    assert (wide.width, wide.height) == (128, 48)
    refused("width 0", generated_camera, "needles", width=0)


@pytest.mark.parametrize(
    "make, arguments, message",
    [
        (generate, ("lawn",), "'lawn'.*garden, antialiased_dust.*, fog"),
        (generate, ("needles", 5), "count: the scene 'needles' has a fixed number"),
        (generate, ("garden", 0), "count: 0"),
        (generate, ("garden", -3), "count: -3"),
        (generate, ("garden", scenes.COUNT_MAX + 1), "count: 20000001"),
        (generate, ("garden", 10, -1), "seed: -1"),
        (generate, ("garden", 10, 0, 4), "sh-degree: 4 is not in 0 … 3"),
        (generate, ("garden", 10, 0, -1), "sh-degree: -1"),
        (
            generate,
            ("needles", None, 0, 1),
            "sh-degree: the scene 'needles' has harmonics of its own",
        ),
        (generated_camera, ("lawn",), "'lawn'"),
        (garden, (0,), "count 0"),
        (garden, (5, -1), "seed -1"),
    ],
)
def test_errors(make, arguments, message):
    refused(message, make, *arguments)


def test_names():
    assert set(ANTIALIASED) == {name for name in HARD if HARD[name](0).scene.antialiased}


def factors(case: HardCase) -> np.ndarray:
    """Share [M] of its opacity that compensation leaves to each splat that stays visible."""
    whole, _ = project(replace(case.scene, antialiased=False).gaussians(), case.camera)
    splats, _ = project(case.scene.gaussians(), case.camera)
    assert case.scene.antialiased and len(splats) <= len(whole)
    stored = case.scene.opacity[splats.index]
    return splats.opacity / stored


def test_antialiased_dust():
    case = HARD["antialiased_dust"](0)
    size = case.scene.scale * 64 / 4  # pixels
    assert size.min() < 0.01 and 0.9 < size.max() <= 1
    kept = factors(case)
    assert len(kept) < 0.7 * len(case.scene) and kept.min() < 0.01 and kept.max() > 0.6


def test_antialiased_needles():
    case = HARD["antialiased_needles"](0)
    assert np.allclose(case.scene.scale[:, 0], 500 * 4 / 64)
    assert np.isclose(case.scene.scale.min(), 0.001 * 4 / 64)
    kept = factors(case)
    assert 0 < len(kept) < len(case.scene) and kept.max() < 0.1


def test_antialiased_edge():
    case = HARD["antialiased_edge"](0)
    splats, _ = project(case.scene.gaussians(), case.camera)
    edge = splats.opacity[splats.index >= 40] / ALPHA_MIN
    assert (edge >= 1).all() and (edge < 1.7).all() and 500 < len(edge) < 1500


def test_antialiased_edge_on():
    case = HARD["antialiased_edge_on"](0)
    kept = factors(case)
    assert kept.min() < 0.1 and np.allclose(case.scene.scale[:, 0] / case.scene.scale[:, 2], 1e5)
    splats, _ = project(replace(case.scene, antialiased=False).gaussians(), case.camera)
    assert len(kept) < 0.6 * len(splats)  # exactly edge-on flakes vanish


def test_antialiased_whole():
    case = HARD["antialiased_whole"](0)
    kept, splats = factors(case), project(case.scene.gaussians(), case.camera)[0]
    assert (kept[splats.index < 8] > 0.999).all() and kept.min() < 0.8
    assert (splats.extent[splats.index < 8] > 64 / 2).all()
