"""The model reader: headers accepted or refused, and the parts it reads, in legal bursts."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.hdl.points.state import ModelState
from splatcore.spec import axi, colour, memory
from splatcore.spec.config import PAPER, Config
from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.registers import ErrorCode, frame_registers
from splatcore.spec.renderable import check_renderable
from tb.helpers.colour_rows import random_model
from tb.helpers.configs import PORTS
from tb.helpers.model_errors import error_in
from tb.helpers.model_memory import Image, check_reading, fetch_ranges
from tb.helpers.point_rows import counts
from tb.helpers.runs import marked

NARROW, WIDE = PORTS.values()

MACHINES = {
    "128 bits": NARROW,
    "256 bits": WIDE,
    "degree 1": replace(NARROW, sh_degree=1, levels=False),
    "degree 0": replace(NARROW, sh_degree=0),
    "PAPER": PAPER,
}
PAGE = axi.BOUNDARY // axi.BEAT
TOP = 1 << axi.BEAT_ADDRESS_BITS
MIXED = np.array([colour.FINE, 0, colour.COARSE, colour.SECOND, 0, colour.FINE, colour.SECOND])

pytestmark = pytest.mark.slow


def model(format: memory.ModelFormat, last: int = 77, layouts: np.ndarray = MIXED) -> PackedModel:
    """Return a model of random bits; without codebooks, its chunks have all layouts of its degree.
    The last chunk has `last` Gaussians."""
    layouts = 0 * layouts if format.codebooks else layouts
    if format.sh_degree < SH_DEGREE_MAX:
        layouts = np.where(layouts == colour.COARSE, colour.FINE, layouts)
    return random_model(format, layouts, [-3, -4, -5, -6], np.random.default_rng(last), last=last)


def spoiled(model: PackedModel, **fields) -> np.ndarray:
    """Return the model's bytes with other header fields; a single value fills an array."""
    image, codes = model.image.copy(), dict(model.header)
    for name, value in fields.items():
        value = np.asarray(value) & 0xFFFF if "exponent" in name else np.asarray(value)
        codes[name] = np.broadcast_to(value, codes[name].shape).astype(np.uint64)
    image[: memory.HEADER.size] = memory.HEADER.pack(codes).reshape(-1)
    return image


def check_header(config: Config, image: np.ndarray, seed: int = 0) -> ErrorCode:
    """Check that the machine accepts a header and outputs its fields, or reports its error."""
    at = Image(image, 4 * seed)
    error = error_in(config, at.header, at.base)
    result = check_reading(config, at, not error, stall=seed % 3 * 0.3, seed=seed)
    ports, degree = result.ports, int(at.header["sh_degree"])
    assert ports["error"] == error and ports["loaded"] == (not error)
    model = [register.name for register in frame_registers(config)].index("MODEL")
    assert ports["detail"] == {ErrorCode.DEGREE: degree, ErrorCode.RANGE: model}.get(error, 0)
    if not error:
        names = ("position_exponent", "small", "antialiased")
        fields = {name: int(at.header[name]) for name in names}
        fields |= {"gaussians": int(at.header["count"]), "sh": int(degree > 0)}
        fields |= {"codebooks": int(at.header["colour_index"].any())}
        fields |= {"exponent": at.header["exponent"].tolist()}
        assert ports["model"] == ModelState.const(fields).as_bits()
        assert ports["given"] and ports.get("levels", 0) == (at.header["version"] == 5)
    return error


ENDS = (-32768, -256, -255, -16, -15, -4, -3, -2, 0, 4, 5, 255, 256, 32767)
"""Exponents at the limits of valid values, and next to them."""

BITS = tuple(np.ndindex(2, 2))

EDITS = [
    *({"magic": memory.MAGIC ^ 1 << bit} for bit in (0, 31)),
    *({"version": version} for version in (0, 2, 4, 5, 0x103, 0xFFFF)),
    *(
        {"version": v, "antialiased": a, "levels": n}
        for v in (3, 4, 5)
        for a, n in np.ndindex(2, 2)
    ),
    *({"sh_degree": degree} for degree in (*range(6), 128, 255)),
    *({"position": position} for position in (0, 1, 2, 64, 127)),
    *({"small": 1, "count": count} for count in (2, 1000)),
    {"small": 1, "colour_index": 0, "sh_index": 0, "exponent": -6},
    *({"position_exponent": e} for e in ENDS),
    *({"exponent": e} for e in ENDS),
    *({"exponent": np.where(np.arange(4) == d, e, -5)} for d in range(4) for e in ENDS[3:-3]),
    *({"colour_index": bits} for bits in (0, [7, 6, 0, 0], [9, 9, 0, 0], [9, 0, 0, 0])),
    *({"colour_index": bits} for bits in ([0, 9, 9, 0], [7, 6, 0, 1])),
    *({"sh_index": bits} for bits in (0, [7, 7, 0, 0], [8, 0, 0, 0], [0, 0, 0, 1])),
    {"colour_index": 0, "sh_index": 0},
    *({"count": count, "exponent": -6} for count in (0, 1, 255, 256, 257, 5 * 256)),
]
"""Changes of header fields, some of them valid."""

OF_DEGREE = {"sh_degree", "colour_index", "sh_index", "version", "magic", "count"}
"""Fields to try on machines of lower degrees, which treat all other fields like `NARROW`."""


@pytest.mark.parametrize("name", marked(MACHINES, ("256 bits", "degree 1", "PAPER")))
def test_headers(name):
    config = MACHINES[name]
    formats = [memory.model_format(config, d) for d in memory.compact_degrees(config)]
    formats += [memory.model_format(PAPER if config is NARROW else NARROW, 1)]
    formats += [memory.model_format(config, max(memory.compact_degrees(config)), small=True)]
    formats += [memory.step_format(config, degree) for degree in (0, 3)]
    formats += [replace(memory.step_format(config, 0), levels=True)] * config.levels
    edits = [edit for edit in EDITS if config in (NARROW, PAPER) or OF_DEGREE & edit.keys()]
    headers = [(model(format), edit) for format in formats for edit in ({}, *edits)]
    seen = [check_header(config, spoiled(m, **e), k) for k, (m, e) in enumerate(headers)]
    wrong = ErrorCode.MAGIC, ErrorCode.VERSION, ErrorCode.FORMAT, ErrorCode.DEGREE
    # codebooks declared in a model without them are beyond its end
    assert set(seen) - {ErrorCode.PARTS} == {ErrorCode.NONE, *wrong}


COUNT_MAX = 100_000  # Gaussians of models whose chunk headers are read


def places(model: PackedModel) -> list[dict[str, int]]:
    """Return addresses of parts around the limits, and counts around the largest that fit."""
    at = {name: model.value(name) for name in memory.PLACED}
    found = [{name: at[name] + k} for name in memory.PLACED for k in (-1, 1)]
    found += [{name: at[name] + (1 << k)} for name in memory.PLACED for k in (26, 28, 31)]
    moved = [1 << 26, (1 << 26) - at["end"], (1 << 26) - at["end"] + 1]
    found += [{name: place + k for name, place in at.items()} for k in moved]
    each, first = at["colours"] - at["attributes"], 2 * (at["positions"] - 1) * 256
    each *= 8 if model.format.small else 4
    counts = [each - 1, each, each + 1, first, first + 1, 1 << 26, (1 << 32) - 1]
    apart = {name: place + (at["end"] << 8) for name, place in at.items() if name != "positions"}
    return found + [more | {"count": k} for k in counts for more in ({}, apart)]


@pytest.mark.parametrize("name", ["128 bits", "PAPER"])
def test_places_of_parts(name):
    """Parts out of order, beyond 4 GiB or too short for the count are refused; parts at the limits
    are accepted."""
    config = MACHINES[name]
    formats = [memory.model_format(config, d) for d in memory.compact_degrees(config)]
    formats += [memory.step_format(config, 3)] * (config.colours == "beside")
    formats += [memory.model_format(config, 1, small=True)] * config.small_models
    seen = []
    for given in map(model, formats):
        for k, fields in enumerate(places(given)):
            header = spoiled(given, **fields)
            top = (1 << axi.BEAT_ADDRESS_BITS) - 4 * given.value("end")
            for base in (4 * k, top, top + 4):
                at = Image(header, base)
                error = error_in(config, at.header, base)
                seen.append(error)
                if error or at.header["count"] < COUNT_MAX:
                    ports = check_reading(config, at, not error).ports
                    assert ports["error"] == error and ports["loaded"] == (not error), fields
    assert {*seen} == {ErrorCode.NONE, ErrorCode.PARTS, ErrorCode.RANGE}


@pytest.mark.parametrize("name", MACHINES)
def test_golden_model_refuses_the_same(name):
    """Models of every format on every machine: `check_renderable` agrees with the hardware."""
    config, seen = MACHINES[name], set()
    formats = [memory.model_format(c, degree) for c in (NARROW, PAPER) for degree in (0, 1)]
    formats += [memory.model_format(NARROW, degree, small=True) for degree in (0, 1)]
    formats += [memory.step_format(config, degree) for degree in range(4)]
    for format in formats:
        given = model(format, 5, MIXED[:1])
        error = error_in(config, Image(given.image, 0).header)
        seen.add(error)
        if error == ErrorCode.NONE:
            check_renderable(config, given)
            continue
        why = f"SH degree {format.sh_degree}.* {config.sh_degree};" if error == 13 else "preset"
        with pytest.raises(InputError, match=f"random: has .*{why}"):
            check_renderable(config, given)
    assert seen >= {ErrorCode.NONE, ErrorCode.FORMAT}


def random_part(rng: np.random.Generator, model: PackedModel) -> tuple[list, np.ndarray]:
    """Return some chunks (number, count) and some of their Gaussians."""
    chosen = np.flatnonzero(rng.random(len(model.chunk_beats)) < 0.7)
    of = np.arange(len(model)) // memory.CHUNK
    index = np.flatnonzero(np.isin(of, chosen) & (rng.random(len(model)) < 0.6))
    return [(k, counts(model)[k]) for k in chosen], index


FORMATS = {
    "steps": (NARROW, memory.step_format(NARROW, 3)),
    "compact, degree 1": (NARROW, memory.model_format(NARROW, 1)),
    "compact, degree 0": (NARROW, memory.model_format(NARROW, 0)),
    "small": (NARROW, memory.model_format(NARROW, 1, small=True)),
    "no harmonics": (MACHINES["degree 0"], memory.step_format(NARROW, 0)),
    "levels": (MACHINES["degree 0"], replace(memory.step_format(NARROW, 0), levels=True)),
    "paper": (PAPER, memory.model_format(PAPER, 1)),
    "steps, 256 bits": (WIDE, memory.step_format(WIDE, 3)),
    "compact, 256 bits": (WIDE, memory.model_format(WIDE, 1)),
}


@pytest.mark.parametrize("name", FORMATS)
def test_models(name):
    """Parts of models at random addresses, with full and partly filled last chunks."""
    config, format = FORMATS[name]
    layouts = np.zeros_like(MIXED) if format.sh_degree == 0 else MIXED
    for seed, last in enumerate((77, 1, memory.CHUNK, 255)):
        given, rng = model(format, last, layouts), np.random.default_rng(seed)
        for stall in (0, 0.3, 0.7):
            fetch, index = random_part(rng, given)
            pairs = np.stack(given.attribute_bursts(index), axis=1)
            base = 4 * int(rng.integers(0, 1 << 20))
            image = Image(given.image, base)
            wanted = [] if axi.port_beats(config) > 1 else pairs.tolist()
            check_reading(config, image, True, fetch, wanted, stall=stall, seed=seed)


def every_offset() -> list[tuple[int, int]]:
    """Return bursts of 1 to 3 beats at all places of a page, in random order."""
    rng = np.random.default_rng(3)
    place, count = np.divmod(rng.permutation(3 * PAGE), 3)
    page = rng.integers(0, 100, 3 * PAGE)
    return np.stack([page * PAGE + place, count + 1], axis=1).tolist()


@pytest.mark.parametrize("stall", [0, 0.4])
def test_no_burst_crosses_a_page(stall):
    image = Image(model(FORMATS["steps"][1]).image, 4 * 4321)
    check_reading(NARROW, image, True, [], every_offset(), stall=stall)


def test_the_end_of_memory():
    """Chunks and attributes of a model as large as memory: no address overflows."""
    count, steps = 197_000_000, memory.step_format(NARROW, 0)
    layout = steps.layout(count)
    assert 0.99 * (TOP << 4) < layout.end <= TOP << 4
    unit = memory.ALIGNMENT
    places = {name: getattr(layout, name) // unit for name in memory.PLACED}
    image = spoiled(model(steps, layouts=0 * MIXED), **places)
    chunks = memory.chunk_count(count)
    fetch = [(0, 256), (chunks - 2, 256), (chunks - 1, count % 256), (chunks // 2, 256)]
    wanted = [(count - k, n) for k, n in ((1, 1), (2, 1), (3, 3), (300, 2))]
    check_reading(NARROW, Image(image, 0), True, fetch, wanted)


@pytest.mark.parametrize("config", PORTS.values(), ids=PORTS)
def test_pace_of_positions(config):
    """One beat of the machine per cycle, plus a few cycles per chunk."""
    image = Image(model(FORMATS["steps"][1]).image, 0)
    begin, chunks = check_reading(config, image).cycles, [(k, 256) for k in range(10, 40)]
    beats = sum(count for _, count in fetch_ranges(config, image, chunks))
    assert check_reading(config, image, True, chunks).cycles < begin + beats + 3 * len(chunks)


def test_pace():
    """A Gaussian takes at most 3 cycles, or 2 if it needs a single beat."""
    image = Image(model(FORMATS["steps"][1]).image, 0)
    begin = check_reading(NARROW, image).cycles
    crossing = [(PAGE * k - 1 - 4 * int(image.header["attributes"]), 2) for k in range(20, 520)]
    for cycles, pairs in ((2, [(k, 1) for k in range(500)]), (3, [(3 * k, 3) for k in range(500)]),
                          (3, crossing)):  # fmt: skip
        taken = check_reading(NARROW, image, True, [], pairs).cycles
        assert taken < max(begin, 100) + cycles * len(pairs) + 16
