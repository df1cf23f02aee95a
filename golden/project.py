"""Golden model of stage 1: points in the guard band, with attributes and codebooks, to splats."""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.golden.colour import codebook_sums, colours
from splatcore.golden.program import Values, run
from splatcore.spec.compensation import ATTENUATIONS
from splatcore.spec.config import Config
from splatcore.spec.decoded import Decoded, values_of
from splatcore.spec.frame import FrameConstants
from splatcore.spec.microprogram import projection
from splatcore.spec.number import Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import COLOURS, SLOPES


@cache
def rounded_values(arithmetic: Float, format: Float) -> np.ndarray:
    """Return the values of all codes of a format, rounded to the arithmetic."""
    return arithmetic.round(values_of(format))


def attributes(config: Config, some: Decoded) -> Values:
    """Return the fields of the projection that come from the attributes of some Gaussians [M].

    L [M] is in units of 2^factor_exponent, the attenuation −log2(opacity) [M] in steps of
    `spec.memory.OPACITY`.
    """
    record, codes = some.model.format.attribute_record, some.attributes
    steps = codes["opacity"].astype(np.float64)
    fields: Values = {name: steps for name in ATTENUATIONS}
    for row in range(3):
        for name in (f"l{row}{k}" for k in range(row + 1)):
            fields[name] = rounded_values(config.arithmetic, record[name])[codes[name]]
    return fields


def project(
    config: Config, frame: FrameConstants, model: PackedModel, points: Values, index: np.ndarray
) -> Values:
    """Return the values of the projection.

    points: [M] camera coordinates x, y, z and rays
    index: [M] the Gaussians
    """
    some = model.stored(index)
    fields = frame.constants | points | attributes(config, some)
    machine = replace(config, antialiasing=config.compensates and model.antialiased)
    if config.colours == "beside":
        return run(config, projection(machine), fields) | colours(config, some, points)
    steps = projection(replace(machine, sh_degree=model.format.sh_degree))
    return run(config, steps, fields | look_up(config, some))


def look_up(config: Config, some: Decoded) -> Values:
    """Return colours, and G for degree 1, of some Gaussians [M] of a compact model, if the array
    computes colours.

    Values [M] of `config.arithmetic` by the names of `spec.programs`: sums
    of entries times 2^E of the header, rounded once.
    """
    fields: Values = {}
    model = some.model
    parts = (("colour", COLOURS), ("sh", SLOPES))[: model.format.sh_degree + 1]
    for (part, names), exponent in zip(parts, model.exponents, strict=False):
        values = np.ldexp(codebook_sums(some, part).astype(np.float64), exponent)
        fields |= zip(names, config.arithmetic.round(values).T, strict=True)
    return fields
