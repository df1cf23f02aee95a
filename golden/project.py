"""Golden model of stage 1: points in the guard band, with attributes and codebooks, to splats."""

from dataclasses import replace

import numpy as np

from splatcore.golden.colour import codebook_sums, colours
from splatcore.golden.program import Values, run
from splatcore.spec.compensation import ATTENUATIONS
from splatcore.spec.config import Config
from splatcore.spec.frame import FrameConstants
from splatcore.spec.microprogram import projection
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import COLOURS, SLOPES


def attributes(config: Config, model: PackedModel, index: np.ndarray) -> Values:
    """Return the fields of the projection that come from attributes.

    index: [M] the Gaussians
    L [M] is in units of 2^factor_exponent, the attenuation −log2(opacity) [M] in steps of
    `spec.memory.OPACITY`.
    """
    record, codes = model.format.attribute_record, model.attributes
    steps = codes["opacity"][index].astype(np.float64)
    fields: Values = {name: steps for name in ATTENUATIONS}
    for row in range(3):
        for name in (f"l{row}{k}" for k in range(row + 1)):
            fields[name] = config.arithmetic.round(record[name].decode(codes[name][index]))
    return fields


def project(
    config: Config, frame: FrameConstants, model: PackedModel, points: Values, index: np.ndarray
) -> Values:
    """Return the values of the projection.

    points: [M] camera coordinates x, y, z and rays
    index: [M] the Gaussians
    """
    fields = frame.constants | points | attributes(config, model, index)
    machine = replace(config, antialiasing=config.compensates and model.antialiased)
    if config.colours == "beside":
        return run(config, projection(machine), fields) | colours(config, model, points, index)
    steps = projection(replace(machine, sh_degree=model.format.sh_degree))
    return run(config, steps, fields | look_up(config, model, index))


def look_up(config: Config, model: PackedModel, index: np.ndarray) -> Values:
    """Return colours, and G for degree 1, of Gaussians of a compact model, if the array computes
    colours.

    index: [M] the Gaussians Values [M] of `config.arithmetic` by the names of `spec.programs`: sums
    of entries times 2^E of the header, rounded once.
    """
    fields: Values = {}
    parts = (("colour", COLOURS), ("sh", SLOPES))[: model.format.sh_degree + 1]
    for (part, names), exponent in zip(parts, model.exponents, strict=False):
        values = np.ldexp(codebook_sums(model, part, index).astype(np.float64), exponent)
        fields |= zip(names, config.arithmetic.round(values).T, strict=True)
    return fields
