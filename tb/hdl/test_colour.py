"""Colours of random models and rays, bit for bit, from the unit next to the array and from the
array itself; codebooks against the packed model."""

import gc
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from splatcore.golden.project import look_up
from splatcore.hdl.points.codebook import Codebook, sum_of
from splatcore.hdl.points.look_up import LookUp
from splatcore.hdl.points.project import Project
from splatcore.spec.colour import (
    COARSE,
    EXPONENT_MAX,
    EXPONENT_MIN,
    FINE,
    LAYOUTS,
    SECOND,
    SH_EXPONENT_MAX,
    slopes_of,
)
from splatcore.spec.config import DEFAULT, PAPER, TINY, Config
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.memory import COMPONENT, SLOPE, compact_degrees, model_format, step_format
from splatcore.spec.microprogram import projection
from splatcore.spec.number import Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import COLOURS, SLOPES
from splatcore.spec.schedule import schedule
from tb.helpers.colour_rows import any_bytes, few_bits, project_case, random_model
from tb.helpers.runs import compiled, marked

MACHINES = {degree: replace(DEFAULT, sh_degree=degree) for degree in range(4)}
DEGREES = (0, 1, pytest.param(2, marks=pytest.mark.verify), 3)
OTHERS = {
    "six cycles": TINY,
    "five cycles": replace(DEFAULT, pes=11),
    "dense": replace(DEFAULT, skip_zeros=False, tile_test="3sigma"),
    "products": replace(DEFAULT, logic="fpga", lanes="block"),
    "few slots": replace(DEFAULT, projection_slots=8),
    "fine colours": replace(DEFAULT, colour_fraction=12, sum_fraction=16),
    "many stages": Config(colour_index=((9,), (5, 4, 3, 2)), sh_index=((), (5, 4, 3))),
}

ARRAY = Config(name="ARRAY", colours="array", sh_degree=1, pes=9)
MANY = replace(
    ARRAY, name="MANY", pes=7, colour_index=((9,), (5, 4, 3, 2)), sh_index=((), (5, 4, 3))
)
"""More stages than `ARRAY`, and a different number of them in models of degree 0."""

ARRAYS = {
    ARRAY: 7,
    PAPER: 5,
    replace(ARRAY, name="PLAIN", sh_degree=0): 2,
    MANY: 10,
}
"""Machines whose colours come from the array, and cycles per look-up in their codebooks."""

LONGER = tuple(
    "five cycles,dense,products,few slots,fine colours,many stages,narrow,wide".split(",")
)
"""Machines that only `make verify` compiles."""

ALONE = [np.full(3, number) for number in range(len(LAYOUTS))]
MIXED = np.array([FINE, 0, COARSE, SECOND, SECOND, FINE, COARSE, 0, FINE, FINE, 0])
LAST = 77
"""Gaussians in the last chunk."""

EXPONENTS = {
    "least": [EXPONENT_MIN] * 4,
    "most": [EXPONENT_MAX] * 4,
    "usual": [-5, -6, -6, -7],
    "any": [0, -7, -2, -4],
}


def check(config: Config, model: PackedModel, seed: int, stall: float = 0.0) -> float:
    """Check splats of random points, bit for bit, and the attributes' read addresses; returns the
    cycles per splat."""
    case = project_case(config, model, np.random.default_rng(seed))
    result = case.check(compiled(Project, config), "project.", stall=stall, seed=seed)
    return result.cycles / len(case.expected["o"])


def steps(
    config: Config, layouts, exponent: str, seed: int, draw=any_bytes, antialiased: bool = False
) -> PackedModel:
    format, rng = step_format(config, 3), np.random.default_rng(seed)
    return random_model(format, layouts, EXPONENTS[exponent], rng, draw, LAST, antialiased)


def compact(config: Config, degree: int, exponents, seed: int, draw=any_bytes) -> PackedModel:
    first, second, *rest = EXPONENTS.get(exponents, exponents)
    exponents = [first, min(second, SH_EXPONENT_MAX), *rest]
    format, rng = model_format(config, degree), np.random.default_rng(seed)
    return random_model(format, np.zeros(4, int), exponents, rng, draw, LAST)


@pytest.mark.slow
@pytest.mark.parametrize("exponent", EXPONENTS)
@pytest.mark.parametrize("degree", DEGREES)
def test_models(degree, exponent):
    """In steps: each layout alone, and all in one model; compact ones. Random codes, and codes at
    the ends of the range."""
    for draw in (any_bytes, few_bits):
        for seed, layouts in enumerate([*ALONE, MIXED]):
            check(MACHINES[degree], steps(DEFAULT, layouts, exponent, seed, draw), seed)
        for of_model in range(min(degree, 1) + 1):
            check(MACHINES[degree], compact(DEFAULT, of_model, exponent, of_model, draw), degree)


@pytest.mark.slow
@pytest.mark.parametrize("degree", DEGREES)
def test_stalls(degree):
    """Streams that stall, on all sides."""
    for seed, stall in enumerate((0.2, 0.5, 0.8)):
        check(MACHINES[degree], steps(DEFAULT, MIXED, "usual", seed), seed, stall)
        check(MACHINES[degree], compact(DEFAULT, min(degree, 1), "usual", seed), seed, stall)


@pytest.mark.slow
@pytest.mark.parametrize("name", marked(OTHERS, LONGER))
def test_other_machines(name):
    config = OTHERS[name]
    for stall in (0, 0.5):
        check(config, steps(config, MIXED, "usual", 1), 1, stall)
        for degree in (0, 1):
            check(config, compact(config, degree, "usual", degree), degree, stall)


COMPENSATING = {
    "default": MACHINES[3],
    "six cycles": TINY,
    "narrow": replace(DEFAULT, arithmetic=Float(6, 9, subnormal=False)),
    "wide": replace(DEFAULT, arithmetic=Float(8, 17, subnormal=False)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", marked(COMPENSATING, LONGER))
def test_compensated_opacities(name):
    """Of Gaussians of any shape and size, at any place."""
    config = COMPENSATING[name]
    for seed, (draw, stall) in enumerate(product((any_bytes, few_bits), (0, 0.4))):
        check(config, steps(config, MIXED, "usual", seed, draw, antialiased=True), seed, stall)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [*DEGREES, "six cycles"])
def test_cycles(degree):
    """Colours add no cycles to the interval; latency adds less than 0.21 per splat here."""
    config, interval = (TINY, 6) if degree == "six cycles" else (MACHINES[degree], 4)
    assert schedule(config, projection(config)).interval == interval
    assert check(config, steps(DEFAULT, ALONE[FINE], "usual", 5), 5) < interval + 0.21


each_array = pytest.mark.parametrize("config", ARRAYS, ids=lambda config: config.name)


@pytest.mark.slow
@pytest.mark.parametrize("config", marked(ARRAYS, [MANY]), ids=lambda config: config.name)
def test_colours_from_the_array(config):
    """All exponents, from the smallest to the largest; entries of any bits, and at the ends of
    their formats; each model's codebooks replace the previous ones."""
    assert (
        ARRAYS[config] == LookUp(config).interval <= schedule(config, projection(config)).interval
    )
    exponents = range(EXPONENT_MIN, EXPONENT_MAX + 1)
    others = np.random.default_rng(12).permutation(exponents).tolist()
    for degree in compact_degrees(config):
        for seed, both in enumerate(zip(exponents, others, strict=True)):
            draw, stall = (any_bytes, few_bits)[seed % 2], (0, 0, 0.4)[seed % 3]
            model = compact(config, degree, (*both, EXPONENT_MIN, EXPONENT_MIN), seed, draw)
            check(config, model, seed, stall)


@pytest.mark.parametrize("degree", [0, 1])
@each_array
def test_golden_reads_the_packed_values(config, degree):
    """Golden values equal those of `PackedModel`, which knows no memory words, rounded once."""
    if degree > config.sh_degree:
        return
    for draw in (any_bytes, few_bits):
        model = compact(config, degree, "usual", degree, draw)
        index = np.random.default_rng(13).permutation(len(model))[: len(model) // 2]
        fields = look_up(config, model.decoded(index))
        base, *first = model.factors
        expected = dict(zip(COLOURS, base[index, 0].T + COLOUR_OFFSET, strict=True))
        if degree:
            slopes = slopes_of(first[0][index]).reshape(-1, 9)
            expected |= dict(zip(SLOPES, slopes.T, strict=True))
        assert set(fields) == set(expected)
        for name, values in expected.items():
            np.testing.assert_array_equal(fields[name], config.arithmetic.round(values), name)


def test_sums_fit():
    """The sum's format holds the sums at both ends; half its range would not."""
    for entry in (COMPONENT, SLOPE):
        for stages in range(1, 5):
            total = sum_of(entry, stages)
            assert total.min <= stages * entry.min and stages * entry.max <= total.max
            assert stages * entry.min < total.min / 2


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
def test_a_small_memory_is_refused():
    with pytest.raises(ValueError, match="codebook"):
        Codebook(Config(name="SMALL", codebook=DEFAULT.codebook // 2))
    with pytest.raises(ValueError, match="slots"):
        Project(replace(DEFAULT, projection_slots=512))
    *_, many = ARRAYS
    with pytest.raises(ValueError, match=r"looked up in 10 cycles.*every 8"):
        Project(replace(many, pes=9))
    gc.collect()  # or Amaranth warns of the unused component during some other test
