"""Binning: the golden model against exact tiles and its linked lists; hardware against golden.
`tb.formal.list_writer` proves the order of entries, their pace, and missing pages."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.bin import Binned, features
from splatcore.golden.footprint import OUTLINE, right_ends
from splatcore.golden.reference import project
from splatcore.hdl.binning.row_end import END_BITS, LATENCY, SLOPE_AT, WIDTH_AT, RowEnd
from splatcore.model.generate.hard import HARD
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.binning import FACTOR_FRACTION, HALF_BITS, lean_margin
from splatcore.spec.colour import colour_format
from splatcore.spec.config import DEFAULT, TINY, Config
from splatcore.spec.convention import ALPHA_MIN, TILE
from splatcore.spec.depth import below_bits, key_shift, whole_codes
from splatcore.spec.feature import FACTOR, FACTOR_SCALE, POSITION, SCALE_MAX, SHEAR, whole_colours
from splatcore.spec.group import entry_record
from splatcore.spec.memory import OPACITY
from splatcore.spec.point import splat_record
from tb.helpers.bin_frames import (
    Frame,
    Outlines,
    bin_frame,
    check,
    compare_tiles,
    pairs,
    read_lists,
)
from tb.helpers.bin_splats import FADED, KINDS, splats, together
from tb.helpers.configs import MACHINES, machines
from tb.helpers.scene_frames import SCENES, scene_frame, with_counts
from tb.helpers.scenes import needs_scenes

BINNING = machines("DEFAULT TINY SHORT SQUARE PAPER FP16")

RATIO = {"needle": 1.2, "vast": 1.05}
"""Largest ratio of tiles found to exact tiles, if not `RATIO_MAX`: for needles and splats of
thousands of pixels, whose unit is some pixels. For squares always as for such splats."""
RATIO_MAX = 1.03


def random_frame(config: Config, count: int, smaller: tuple[int, int] = (0, 0), **options) -> Frame:
    """Return a frame with splats of all kinds, `smaller` than the machine's largest image."""
    width, height = config.width_max - smaller[0], config.height_max - smaller[1]
    kinds = (*KINDS, FADED) if config.compensates else KINDS
    parts = [splats(config, kind, count, (width, height)) for kind in kinds]
    parts.append(at_edges(config, together(*parts), (width, height)))
    parts.append(stretched(config, splats(config, "vast", count, (width, height))))
    return Frame(together(*parts), width, height, **options)


def stretched(config: Config, codes: dict) -> dict:
    """Return the splats wider and, by the same factor, farther to the side, beyond any scale."""
    factor = 2.0 ** np.random.default_rng(1).integers(0, 24, len(codes["u"]))
    names = ("u", "half_width", "slope") if config.tile_test == "exact" else ("u", "radius")
    wider = {name: config.arithmetic.decode(codes[name]) * factor for name in names}
    return codes | {name: config.arithmetic.encode(value) for name, value in wider.items()}


def at_edges(config: Config, codes: dict, size: tuple[int, int]) -> dict:
    """Return the splats, most of them moved so that a side of their box is in or near the image."""
    rng, moved = np.random.default_rng(0), dict(codes)
    lengths = ("half_width", "half_height") if config.tile_test == "exact" else ("radius", "radius")
    for place, length, pixels in zip("uv", lengths, size, strict=True):
        count, unit = len(codes[place]), 2.0**config.screen_exponent
        half = config.arithmetic.decode(codes[length]) * rng.choice([-1, 1], count)
        there = rng.uniform(-TILE, pixels + TILE, count) / unit + half
        stay = rng.random(count) < 0.3
        moved[place] = np.where(stay, codes[place], config.arithmetic.encode(there))
    return moved


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["DEFAULT", "TINY", "SQUARE_HD", "SQUARE"])
def test_no_tile_is_missing(name, kind):
    config = MACHINES[name]
    for smaller in (0, 11):
        size = (config.width_max - smaller, config.height_max - 2 * smaller)
        count = 1000 if config.tile_test == "3sigma" else 2000
        count = 500 if kind in ("huge", "vast") else count  # they touch thousands of tiles each
        frame = Frame(splats(config, kind, count, size, seed=smaller), *size)
        found = bin_frame(config, frame)
        exact, missing = compare_tiles(config, frame, found)
        assert exact > 200 and missing == 0
        ratio = RATIO.get(kind if config.tile_test == "exact" else "vast", RATIO_MAX)
        assert exact <= pairs(found) <= exact * ratio


@pytest.mark.parametrize("tile_test", ["exact", "3sigma"])
def test_opacities_below_a_level_touch_nothing(tile_test):
    config = replace(TINY, tile_test=tile_test)
    frame = Frame(splats(config, FADED, 2000, (64, 64)), 64, 64)
    found = bin_frame(config, frame)
    attenuation = config.arithmetic.decode(frame.splats["attenuation"])
    seen = attenuation * OPACITY.step < -np.log2(ALPHA_MIN)
    assert (attenuation[seen] == 255.75).any() and (attenuation[~seen] == 255.875).any()
    assert not found.splat_entries[~seen].any()
    assert found.splat_entries[seen].astype(bool).mean() > 0.5
    assert found.features["opacity"].max() == (1 << OPACITY.width) - 1


@pytest.mark.parametrize("name", ["DEFAULT", "SQUARE_HD"])
def test_missing_tile_is_detected(name):
    config = MACHINES[name]
    frame = Frame(splats(config, "common", 100, (640, 400)), 640, 400)
    found = bin_frame(config, frame)
    mask = found.entries["mask"]
    whole = np.flatnonzero(mask == (1 << config.group**2) - 1)  # an inner group of a large splat
    mask[whole[0]] ^= 1
    assert compare_tiles(config, frame, found)[1] == 1


@pytest.mark.parametrize("name, count", with_counts(SCENES))
def test_against_reference(name, count):
    """No tile is missing, neither by the splats' own codes nor by the float64 reference."""
    frame, model, camera, points = scene_frame(name, count)
    found = bin_frame(DEFAULT, frame)
    exact, missing = compare_tiles(DEFAULT, frame, found)
    assert missing == 0 and exact <= pairs(found) <= RATIO_MAX * exact
    drawn, _ = project(model.gaussians(), camera)
    drawn = drawn[np.isin(drawn.index, points.index)]
    outlines = Outlines(drawn.centre, drawn.conic, drawn.reach)
    place = np.searchsorted(points.index, drawn.index)
    exact, missing = compare_tiles(DEFAULT, frame, found, outlines, place)
    assert missing == 0 and exact <= pairs(found) <= RATIO_MAX * exact
    assert len(drawn) > 0.9 * len(found.kept)


def test_features():
    """Colours are clamped at 0, saturate, are scaled by 255/256 and lose low bits if bright;
    centres beyond 2^11 pixels have coarser units; factors lose no leading bit."""
    format, colour = DEFAULT.arithmetic, colour_format(DEFAULT)
    value = {"red": [-1.0, 0.25, 1e9], "green": [1.25, 1.255, 3], "blue": [0] * 3}
    value |= {"attenuation": [0, 9, 255], "u": [0.1, -2.5, 1e5], "v": [-2047.9, 7000, 1e9]}
    value |= {"power_across": [2.4, 1e-30, 0], "power_along": [2**-40 * (1 + 2**-9), 0.3, 1]}
    value |= {"shear": [-0.1, 1e-6, -1e7]}
    formats = dict(splat_record(DEFAULT).fields)
    codes = {n: formats.get(n, format).encode(np.array(numbers)) for n, numbers in value.items()}
    found = features(DEFAULT, codes)
    whole = {n: whole_colours(DEFAULT, found[n].astype(int), np.where) for n in ("red", "green")}
    largest = round(((1 << colour.width) - 2**-3) * 255 / 256)
    assert [0, 128, largest + 8 >> 4 << 4] == whole["red"].tolist()
    assert whole["green"].tolist() == [638, 640, 1536 - 6 + 8 >> 4 << 4]
    assert found["opacity"].tolist() == [0, 9, 255]
    assert found["scale"].tolist() == [0, 2, SCALE_MAX]
    assert POSITION.decode(found["u"]).tolist() == [26 / 256, -2.5 / 4, round(1e5 / 128) / 256]
    assert POSITION.decode(found["v"]).tolist() == [-2047.90625, 1750, POSITION.max]
    across, along = (np.ldexp(FACTOR.decode(found[n]), -FACTOR_SCALE) for n in ("across", "along"))
    assert across.tolist() == [round(2.4 * 256) / 256, 0, 0]
    assert along.tolist() == [2**-40 * (1 + 2**-9), round(0.3 * 2048) / 2048, 1]
    assert SHEAR.decode(found["shear"]).tolist() == [-round(0.1 * 2**14) / 2**14, 0, -SHEAR.max]


@pytest.mark.parametrize("name", ["DEFAULT", "TINY"])
def test_lists_hold_every_entry_in_order(name):
    config = MACHINES[name]
    frame = random_frame(config, 200, (5, 3))
    found = bin_frame(config, frame)
    record, longest = entry_record(config), 0
    for group, slots in enumerate(read_lists(config, found.lists)):
        codes = record.unpack(slots.astype("<u8").view(np.uint8).reshape(-1, 8)[:, : record.size])
        for field, expected in found.entries.items():
            assert (codes[field] == expected[found.group == group]).all()
        longest = max(longest, len(slots))
    assert longest > 3 * config.page
    z, low = (frame.splats[field][found.kept].astype(np.int64) for field in ("z", "z_low"))
    z = whole_codes(config, z, low)
    keys = found.entries["key"][np.argsort(z[found.entries["splat"].astype(int)], kind="stable")]
    assert (np.diff(keys.astype(np.int64)) >= 0).all() and keys[0] < keys[-1]


def test_memory_that_is_too_small():
    frame = random_frame(TINY, 100)
    whole = bin_frame(TINY, frame).lists
    for pages in (0, 1, whole.needed - 1, whole.needed):
        lists = bin_frame(TINY, Frame(frame.splats, frame.width, frame.height, pages)).lists
        assert lists.needed == whole.needed and (lists.count == whole.count).all()
        inside = whole.address < pages * TINY.page // TINY.burst
        assert (lists.address == whole.address[inside]).all()
        assert (lists.slots == whole.slots[inside]).all()
        assert inside.all() == (pages == whole.needed)


def check_cycles(run, results: list[Binned]):
    """Check that a run takes at most one cycle per row and entry, plus some per frame."""
    rows, entries = sum(r.rows for r in results), sum(len(r.group) for r in results)
    overhead = sum(2 * len(result.lists.count) + 100 for result in results)
    assert run.cycles <= rows + entries + overhead


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(k, marks=pytest.mark.verify if k == "SQUARE" else ()) for k in BINNING],
)
def test_hardware_equals_golden(name):
    """Frames of several sizes in one run: no frame leaves state for the next."""
    config = MACHINES[name]
    count = 150 if config.width_max == TINY.width_max else 40
    frames = [random_frame(config, count, smaller) for smaller in ((0, 0), (11, 27), (0, 0))]
    needed = bin_frame(config, frames[0]).lists.needed
    little = Frame(frames[0].splats, frames[0].width, frames[0].height, needed // 2)
    tiny = random_frame(config, 3, (config.width_max - 1, config.height_max - 1))
    empty = {field: codes[:0] for field, codes in frames[0].splats.items()}
    frames = [frames[0], little, Frame(empty, 17, 16), *frames[1:], tiny]
    for seed, stall in enumerate((0, 0.2, 0.5, 0.8)):
        _, results = check(config, frames, stall, seed)
    quarters = set(results[0].entries["key"] >> config.sort_key_bits - 2)
    if key_shift(config):  # keys in steps of one, two and many codes, and below the base
        assert {0, 2, 3} <= quarters
        assert (results[0].entries["key"] < 1 << below_bits(config)).any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["garden", *HARD])
def test_hardware_equals_golden_on_generated_scenes(name):
    frame, *_ = scene_frame(name, None)
    if len(frame):
        run, results = check(DEFAULT, [frame], 0)
        check(DEFAULT, [frame, frame], 0.4, seed=len(name))
        if name == "garden":
            check_cycles(run, results)
    if frame.width <= TINY.width_max and frame.height <= TINY.height_max:
        check(TINY, [frame, frame], 0.3)


@needs_scenes
@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_hardware_equals_golden_on_scenes(name):
    frame, *_ = scene_frame(name)
    check_cycles(*check(DEFAULT, [frame], 0))
    check(DEFAULT, [frame], 0.4, seed=len(name))


@pytest.mark.slow
def test_queues_and_buffers_fill_and_run_empty():
    """The feature queue fills up, and splats wait; buffers of all levels are filled and flushed."""
    frames = [random_frame(TINY, 60 + k, (k, 0)) for k in range(8)]
    run, results = check(MACHINES["SHORT"], frames, 0.8)
    room, finishing = run.samples["room"], run.samples["finishing"]
    assert not room.all() and room.any()
    assert (finishing[1:] < finishing[:-1]).sum() == len(frames)  # each began with nothing inside
    for when in (0, 1):
        assert run.samples["bursts__valid"][finishing == when].any()
    counts = np.concatenate([result.lists.count for result in results])
    slots = (counts[counts > 0] - 1) % (TINY.page - 1) + 1  # a page's last slot is no entry
    assert set(slots % TINY.burst) == set(range(TINY.burst))


SHEAR_AT = 2  # cycles from a band to its shear


def bands(count: int) -> dict[str, np.ndarray]:
    """Return bands [N] of outlines of all sizes; lean is inside, beyond, or near the margin."""
    rng = np.random.default_rng(0)
    half = rng.integers(2, 1 << rng.integers(2, HALF_BITS + 1, count))
    low, high = np.sort(rng.integers(-half, half + 1, (2, count)), axis=0)
    edge = np.where(rng.random(count) < 0.5, low, high)
    about = edge + rng.integers(-2, 3, count) * lean_margin(TINY) + rng.integers(-1, 2, count)
    anywhere = rng.integers(-half, half + 1)
    most = 2 << FACTOR_FRACTION
    return {
        "low": low,
        "high": high,
        "box": (rng.random(count) < 0.05).astype(np.int64),
        "lean": np.where(rng.random(count) < 0.5, np.clip(about, -half, half), anywhere),
        "half": half,
        "normalise": HALF_BITS - np.frexp(half.astype(np.float64))[1].astype(np.int64),
        "shear": rng.integers(1 - most, most, count),
        "slope": rng.integers(1, most + 1, count),
        "half_width": rng.integers(1, 1 << HALF_BITS, count),
    }


@pytest.mark.slow
def test_row_end_equals_golden():
    """To the unit; tests of tiles would miss such errors."""
    count, margin = 20_000, lean_margin(TINY)
    given, row_end = bands(count), RowEnd(TINY)
    edges = (given["low"] - margin == given["lean"], given["high"] + margin == given["lean"])
    assert all((edge & (given["box"] == 0)).sum() > 100 for edge in edges)
    late = {"shear": SHEAR_AT, "slope": SLOPE_AT, "half_width": WIDTH_AT}
    constants = {"passing": np.full(count + LATENCY, (1 << LATENCY) - 1, np.uint64)}
    for name, values in given.items():
        width = len(getattr(row_end, name))
        codes = np.zeros(count + LATENCY, np.uint64)
        start = late.get(name, 0)
        codes[start : start + count] = values & ((1 << width) - 1)
        constants[name] = codes
    simulation = Simulation(row_end, ["o"])
    found = simulation.run({}, constants=constants).samples["o"].astype(np.int64)
    found = found[LATENCY : LATENCY + count]
    found -= (found >> END_BITS - 1) << END_BITS
    outlines = np.zeros(count, OUTLINE)
    outlines["x"]["half"], outlines["y"]["half"] = given["half_width"], given["half"]
    for name in ("shear", "slope", "lean", "normalise"):
        outlines[name] = given[name]
    expected = right_ends(TINY, outlines, given["low"], given["high"])
    assert (found == np.where(given["box"], given["half_width"], expected)).all()
