"""Golden model of the codebooks: from Gaussians' indices to colours and harmonics."""

import numpy as np

from splatcore.golden.program import Values
from splatcore.spec.config import Config
from splatcore.spec.memory import CODEBOOK_WORD, COLOUR_ENTRY, SH_ENTRY
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import COLOURS, SLOPES
from splatcore.spec.record import Record


def look_up(config: Config, model: PackedModel, index: np.ndarray) -> Values:
    """Colours, and G if the model has harmonics, of the Gaussians `index` [M] of a model.

    Values [M] that `config.arithmetic` holds, by the names of `spec.programs`: the sums of the
    entries, times 2^exponent of the header, rounded once.
    """
    fields = _fields(config, model, index, COLOURS, COLOUR_ENTRY, "colour")
    if model.format.sh_degree:
        fields |= _fields(config, model, index, SLOPES, SH_ENTRY, "sh")
    return fields


def _fields(
    config: Config,
    model: PackedModel,
    index: np.ndarray,
    names: tuple[str, ...],
    record: Record,
    part: str,
) -> Values:
    """The numbers of one codebook by name."""
    stages = [name for name in model.format.codebook_words if name.startswith(part)]
    total = sum(_entries(model, record, stage)[model.attributes[stage][index]] for stage in stages)
    values = np.ldexp(total.astype(np.float64), model.value(f"{part}_exponent"))
    return dict(zip(names, config.arithmetic.round(values).T, strict=True))


def _entries(model: PackedModel, record: Record, stage: str) -> np.ndarray:
    """All entries of a stage, integers [2^bits, D]."""
    words = model.image[model.layout.colours :]  # what is copied to the codebook memory
    start = model.format.codebook_words[stage] * CODEBOOK_WORD
    count = 1 << model.format.attribute_record[stage].width
    codes = record.unpack(words[start:][: count * record.size].reshape(count, record.size))
    (field, format), *_ = record.fields  # the other field is reserved
    return format.decode(codes[field]).astype(np.int64)
