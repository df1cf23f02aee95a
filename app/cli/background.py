"""The options of a picture's background: a colour, or none and alpha."""

from dataclasses import dataclass, replace

from splatcore.app.cli.options import PICTURE
from splatcore.sim.common.choice import parse_colour
from splatcore.sim.common.option import option
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE, Convention
from splatcore.spec.error import InputError
from splatcore.spec.renderable import check_format


@dataclass(frozen=True)
class Background:
    """The options."""

    background: tuple[float, float, float] = option(
        "0,0,0", "R,G,B", "Background colour, each 0 … 1.", panel=PICTURE, read=parse_colour
    )
    rgba: bool = option(
        False,
        None,
        "Write alpha, without a background. A machine needs `rgba = true` in its preset's file.",
        panel=PICTURE,
    )

    def shot(self, config: Config, engine: str, convention: Convention = SPLATCORE) -> dict:
        """Return these fields of a frame; InputError if the engine or machine has no alpha."""
        if self.rgba and any(self.background):
            raise InputError("--rgba: no --background")
        if engine != "reference":
            check_format(config, self.rgba)
        convention = replace(convention, background=self.background)
        return {"config": config, "convention": convention, "rgba": self.rgba}
