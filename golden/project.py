"""Golden model of stage 1: points in the guard band, with attributes and codebooks, to splats."""

from dataclasses import replace

import numpy as np

from splatcore.golden.program import Values, run
from splatcore.spec.config import Config
from splatcore.spec.frame import FrameConstants
from splatcore.spec.memory import CODEBOOK_WORD, COLOUR_ENTRY, SH_ENTRY
from splatcore.spec.microprogram import projection
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import COLOURS, SLOPES
from splatcore.spec.record import Record


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


def look_up(config: Config, model: PackedModel, index: np.ndarray) -> Values:
    """Colours, and G if the model has harmonics, of the Gaussians `index` [M] of a model.

    Values [M] that `config.arithmetic` holds, by the names of `spec.programs`: the sums of the
    entries, times 2^exponent of the header, rounded once.
    """
    fields: Values = {}
    for part, names, record in (("colour", COLOURS, COLOUR_ENTRY), ("sh", SLOPES, SH_ENTRY)):
        stages = [name for name in model.format.codebook_words if name.startswith(part)]
        if stages:
            chosen = (_entries(model, record, s)[model.attributes[s][index]] for s in stages)
            values = np.ldexp(sum(chosen).astype(np.float64), model.value(f"{part}_exponent"))
            fields |= zip(names, config.arithmetic.round(values).T, strict=True)
    return fields


def _entries(model: PackedModel, record: Record, stage: str) -> np.ndarray:
    """All entries of a stage, integers [2^bits, D]."""
    words = model.image[model.layout.colours :]  # what is copied to the codebook memory
    start = model.format.codebook_words[stage] * CODEBOOK_WORD
    count = 1 << model.format.attribute_record[stage].width
    codes = record.unpack(words[start:][: count * record.size].reshape(count, record.size))
    (field, format), *_ = record.fields  # the other field is reserved
    return format.decode(codes[field]).astype(np.int64)
