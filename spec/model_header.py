"""The header of a packed model: the model's format, checked for contradictions."""

from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

import numpy as np

from splatcore.spec import memory
from splatcore.spec.colour import DEGREES, EXPONENT_MAX, EXPONENT_MIN, SH_EXPONENT_MAX
from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.error import InputError
from splatcore.spec.memory import HEADER, Layout, ModelFormat


@dataclass(frozen=True, eq=False)
class ModelHeader:
    """A packed model, or at least its header."""

    image: np.ndarray  # uint8 [HEADER.size or more]
    name: str = ""  # file or scene, for error messages

    def __post_init__(self):
        """Raise InputError, naming the field, for a header that contradicts itself."""
        if len(self.image) < HEADER.size or self.value("magic") != memory.MAGIC:
            self.refuse("magic", "does not mark a packed model")
        if self.value("version") not in memory.VERSIONS:
            self.refuse(
                "version",
                f"{self.value('version')} is not {' or '.join(map(str, memory.VERSIONS))}; repack "
                "the scene: splatcore pack SCENE -o MODEL",
            )
        has_levels = self.value("version") == memory.VERSIONS[-1]
        if self.value("levels") != has_levels:
            self.refuse("levels", f"does not go with version {self.value('version')}")
        if not has_levels and self.value("version") != memory.VERSIONS[self.antialiased]:
            self.refuse("antialiased", f"does not go with version {self.value('version')}")
        degree = self.value("sh_degree")
        if degree > SH_DEGREE_MAX:
            self.refuse("sh_degree", f"{degree} is not in 0 … {SH_DEGREE_MAX}")
        if self.value("position") >= len(memory.POSITION_FORMATS):
            self.refuse("position", f"{self.value('position')} is unknown")
        if has_levels and self.format.position == "absolute":
            self.refuse("levels", "is only for models with a grid")
        for field in ("position_exponent", "factor_exponent"):
            if abs(self.value(field)) > memory.EXPONENT_MAX:
                self.refuse(field, f"{self.value(field)} is not within ± {memory.EXPONENT_MAX}")
        for field in ("colour_index", "sh_index"):
            if self.header[field].max() > 16:
                self.refuse(field, f"of {self.header[field].max()} bits is over 16")
        codebooks = self.format.codebooks
        if self.format.small and not codebooks:
            self.refuse("small", "is only for models with codebooks")
        if codebooks and degree > memory.COMPACT_DEGREE:
            self.refuse("colour_index", f"names codebooks, which SH degree {degree} cannot have")
        if bool(self.header["sh_index"].any()) != (codebooks and degree > 0):
            self.refuse("sh_index", f"does not go with SH degree {degree}")
        least, most = EXPONENT_MIN, [EXPONENT_MAX] * DEGREES
        if codebooks:
            most[1] = SH_EXPONENT_MAX
        if not all(least <= e <= end for e, end in zip(self.exponents, most, strict=True)):
            self.refuse("exponent", f"{self.exponents} is not within {least} … {most}")
        try:
            _ = self.format.attribute_record, self.format.stored_record
        except ValueError as error:
            self.refuse("colour_index", str(error))

    def refuse(self, field: str, why: str) -> NoReturn:
        """Raise the InputError of a field."""
        raise InputError(f"{self.name}: {field} {why}")

    @cached_property
    def header(self) -> dict[str, np.ndarray]:
        """Codes of the header's fields, one record."""
        return HEADER.unpack(self.image[: HEADER.size].reshape(1, -1))

    def value(self, field: str) -> int:
        """Return a number of the header."""
        return int(HEADER[field].decode(self.header[field])[0])

    @property
    def count(self) -> int:
        """Number of stored Gaussians, those of coarser levels included."""
        return self.value("count")

    @property
    def antialiased(self) -> bool:
        """Whether opacities must be compensated for the blur."""
        return bool(self.value("antialiased"))

    @cached_property
    def format(self) -> ModelFormat:
        """Formats of the model's parts."""
        stages = {
            f: tuple(int(b) for b in self.header[f][0] if b) for f in ("colour_index", "sh_index")
        }
        position = memory.POSITION_FORMATS[self.value("position")]
        small = bool(self.value("small"))
        levels = bool(self.value("levels"))
        return ModelFormat(self.value("sh_degree"), position, **stages, small=small, levels=levels)

    @cached_property
    def exponents(self) -> list[int]:
        """E of each degree."""
        return [int(e) for e in HEADER["exponent"].decode(self.header["exponent"])[0]]

    def layout_of(self, harmonics: int) -> Layout:
        """Return the byte offsets of the parts with `harmonics` beats of harmonics in all."""
        return self.format.layout(self.count, harmonics)
