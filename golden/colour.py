"""Golden model of colours: directions to polynomials, sums of small integers (`spec.colour`)."""

from dataclasses import replace
from functools import cache
from weakref import WeakKeyDictionary

import numpy as np

from splatcore.golden.codes import round_values
from splatcore.golden.program import Values, run
from splatcore.spec import colour as spec
from splatcore.spec.config import Config
from splatcore.spec.decoded import Decoded
from splatcore.spec.memory import CHUNK, CODEBOOK_WORD, COLOUR_ENTRY, SH_ENTRY
from splatcore.spec.microprogram import basis
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import BASIS_CONSTANTS
from splatcore.spec.record import Record

ONE = 1 << spec.POLYNOMIAL.fraction
"""The polynomial 1 of the base, in steps of `POLYNOMIAL`."""

_tables: WeakKeyDictionary[PackedModel, dict] = WeakKeyDictionary()
"""Models' decoded codebooks: name → stage → entries."""


def colours(config: Config, some: Decoded, rays: Values) -> Values:
    """Return the colours of some Gaussians [M], values of `unscaled_colour_format`.

    rays: [M] vectors from the camera, world axes, values of `Config.arithmetic`
    Returns red, green and blue [M].
    """
    factors = polynomials(config, rays) if config.sh_degree else []
    make = from_codebooks if some.model.format.codebooks else from_steps
    total = make(some, factors)  # [M, 3]
    format = spec.unscaled_colour_format(config)
    colour = np.ldexp(rounded(total, spec.TOTAL_FRACTION - format.fraction), -format.fraction)
    return dict(zip(spec.CHANNELS, np.clip(colour, 0, format.max).T, strict=True))


def rounded(total: np.ndarray, bits: int) -> np.ndarray:
    """Drop the lowest bits, rounded to nearest, a half upwards; shift up if bits < 0."""
    return total + (1 << bits >> 1) >> bits if bits > 0 else total << -bits


@cache
def _shading(config: Config) -> Config:
    """Return the machine with the arithmetic of polynomials."""
    return replace(config, arithmetic=spec.BASIS)


def polynomials(config: Config, rays: Values) -> list[np.ndarray]:
    """Return for each of the machine's `TERMS` its polynomials [M, k] in steps of 2^−11, int64."""
    machine = _shading(config)
    inputs = {f"ray_{axis}": round_values(spec.BASIS, rays[f"ray_{axis}"]) for axis in "xyz"}
    values = run(machine, basis(config), BASIS_CONSTANTS | inputs)
    found, end = [], 1 << spec.POLYNOMIAL.width - 1
    for term in spec.TERMS:
        if term.degree <= config.sh_degree:
            own = np.stack([values[name] for name in term.polynomials], axis=1)
            steps = np.rint(own * 2.0 ** (np.array(term.doubled) + spec.POLYNOMIAL.fraction))
            found.append(np.clip(steps, -end, end - 1).astype(np.int64))
    return found


def add_term(total: np.ndarray, sums: np.ndarray, factor, shift):
    """Add a term's sums [M, 3] to the total [M, 3].

    factor, shift: [M], or one number for all
    """
    factor, shift = (np.broadcast_to(x, len(sums))[:, None] for x in (factor, shift))
    total += (sums * factor << spec.GAIN) >> shift


def from_steps(some: Decoded, factors: list[np.ndarray]) -> np.ndarray:
    """Return the totals [M, 3] of some Gaussians [M] of a model in steps."""
    model, index = some.model, some.index
    of, exponent = index // CHUNK, np.array(model.exponents)
    s = model.chunks["step"][of].astype(np.int64)  # [M, 4]
    factor, shift = 4 - (s & 1), spec.GAIN - exponent + (s >> 1)
    base = [spec.BASE.decode(some.attributes[c]).astype(np.int64) for c in spec.CHANNELS]
    total = np.full((len(index), 3), 1 << spec.TOTAL_FRACTION - 1)
    add_term(total, 2 * np.stack(base, axis=1) * ONE, factor[:, 0], shift[:, 0])
    for number, layout in enumerate(spec.LAYOUTS):
        chosen = np.flatnonzero(model.chunks["harmonics"][of] == number)
        codes, own = model.harmonics(index[chosen], layout)
        part = total[chosen]
        for k, one in layout.terms:
            if k < len(factors):
                d, first = one.degree, one.first
                of_term = codes[d][:, first : first + len(one.polynomials)]  # [M, k, 3]
                halved = 2 * of_term + layout.halves
                sums = np.einsum("mkc,mk->mc", halved, factors[k][chosen])
                add_term(part, sums, factor[chosen, d], shift[chosen, d] + own[d])
        total[chosen] = part
    return total


def from_codebooks(some: Decoded, factors: list[np.ndarray]) -> np.ndarray:
    """Return the totals [M, 3] of some Gaussians [M] of a compact model."""
    model, total = some.model, np.zeros((len(some), 3), np.int64)
    shift = spec.GAIN - np.array(model.exponents)
    add_term(total, 2 * codebook_sums(some, "colour") * ONE, 4, shift[0])
    if model.format.sh_degree:
        g = codebook_sums(some, "sh").reshape(-1, 3, 3)  # channel × axis
        axes = factors[0][:, [2, 0, 1]]  # x, y, z of y, z, x
        for part, finer in ((g & (1 << spec.LOW) - 1, 0), (g >> spec.LOW, spec.LOW)):
            sums = np.einsum("mcx,mx->mc", part, axes)
            add_term(total, sums, 4, shift[1] - 1 - finer)
    return total


def codebook_sums(some: Decoded, part: str) -> np.ndarray:
    """Return the sums [M, D] of all stages' entries of the "colour" or "sh" codebook, integers."""
    record = COLOUR_ENTRY if part == "colour" else SH_ENTRY
    tables = _tables.setdefault(some.model, {})
    if part not in tables:
        stages = [name for name in some.model.format.codebook_words if name.startswith(part)]
        tables[part] = {stage: _entries(some.model, record, stage) for stage in stages}
    return sum(table[some.attributes[stage]] for stage, table in tables[part].items())


def _entries(model: PackedModel, record: Record, stage: str) -> np.ndarray:
    """Return all entries of a stage, integers [2^bits, D]."""
    words = model.image[model.layout.colours :]  # the contents of the codebook memory
    start = model.format.codebook_words[stage] * CODEBOOK_WORD
    count = 1 << model.format.attribute_record[stage].width
    codes = record.unpack(words[start:][: count * record.size].reshape(count, record.size))
    (field, format), *_ = record.fields  # the other field is reserved
    return format.decode(codes[field]).astype(np.int64)
