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
    """L and −log2(opacity) of Gaussians `index` [M]: fields of the projection.

    L in units of 2^factor_exponent, the attenuation in steps of `spec.memory.OPACITY`.
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
    """Values of the projection of Gaussians `index` [M].

    `points` are their camera coordinates x, y, z and their rays.
    """
    fields = frame.constants | points | attributes(config, model, index)
    machine = replace(config, antialiasing=config.compensates and model.antialiased)
    if config.colours == "beside":
        return run(config, projection(machine), fields) | colours(config, model, points, index)
    steps = projection(replace(machine, sh_degree=model.format.sh_degree))
    return run(config, steps, fields | look_up(config, model, index))


def look_up(config: Config, model: PackedModel, index: np.ndarray) -> Values:
    """Colours, and G if the model has harmonics, of the Gaussians `index` [M] of a compact model,
    for arrays that make colours.

    Values [M] that `config.arithmetic` holds, by the names of `spec.programs`: the sums of the
    entries, times 2^E of the header, rounded once.
    """
    fields: Values = {}
    parts = (("colour", COLOURS), ("sh", SLOPES))[: model.format.sh_degree + 1]
    for (part, names), exponent in zip(parts, model.exponents, strict=False):
        values = np.ldexp(codebook_sums(model, part, index).astype(np.float64), exponent)
        fields |= zip(names, config.arithmetic.round(values).T, strict=True)
    return fields
