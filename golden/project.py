"""Golden model of stage 1: points in the guard band and their attributes, projected to splats."""

from dataclasses import replace

import numpy as np

from splatcore.golden.codebook import look_up
from splatcore.golden.program import Values, run
from splatcore.spec.config import Config
from splatcore.spec.frame import FrameConstants
from splatcore.spec.microprogram import projection
from splatcore.spec.packed import PackedModel


def attributes(config: Config, model: PackedModel, index: np.ndarray) -> Values:
    """L and −log2(opacity) of Gaussians `index` [M]: fields of the projection.

    L in units of 2^factor_exponent, the attenuation in steps of `spec.memory.OPACITY`.
    """
    record, codes = model.format.attribute_record, model.attributes
    fields: Values = {"attenuation": codes["opacity"][index].astype(np.float64)}
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
    fields = points | attributes(config, model, index) | look_up(config, model, index)
    steps = projection(replace(config, sh_degree=model.format.sh_degree))
    return run(config, steps, frame.constants | fields)
