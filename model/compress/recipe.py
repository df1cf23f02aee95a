"""The options of a compression: one value for each decision that a user may take."""

from dataclasses import dataclass

from splatcore.model.pack.quality import COMPACT, QUALITIES, STEPPED
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.memory import COMPACT_DEGREE
from splatcore.spec.scene import Scene

ORDERS = ("distill-first", "prune-first")
"""Harmonics go before Gaussians, or after them as in the paper. Gaussians merged later are
fine-tuned as the machine will show them; harmonics distilled later cost fewer steps."""

TARGETS = {
    "--target-ratio": "target_ratio", "--target-bytes": "target_bytes",
    "--target-psnr": "target_psnr", "--target-fps": "target_fps", "--max-drop": "max_drop",
}  # fmt: skip
"""Options that decide how much goes, and their fields."""


@dataclass(frozen=True)
class Learning:
    """Learning rates of a compression, as shares of those with which fine-tuning begins.

    A model in codebooks goes on to learn under its numbers with the rates that fine-tuning ended
    with. In a model in steps rounding moves less: its fine-tuning comes to rest first, and learning
    under its numbers begins with higher rates again, but not with all of them, by which a scene
    loses more than it gains (docs/compression.md).
    """

    left: float  # at the end of fine-tuning
    numbers: float  # at the beginning under the packed model's numbers
    last: float = 0.02  # of these that is left at the end


IN_CODEBOOKS, IN_STEPS = Learning(0.3, 0.3), Learning(0.03, 0.2)


@dataclass(frozen=True)
class Recipe:
    """Options of a compression. InputError names the option of a value that cannot be.

    A pruning rate is the share of the Gaussians that a step removes. A target decides how many go:
    at once, with the steps of all prunings of the schedule. A ratio to the scene's PLY, bytes and
    frames a second are those of the packed model; a PSNR is that on views kept aside. With
    `max_drop` pruning goes on by the schedule's rates until the loss on such views would pass it.
    At most one of these decides.
    """

    schedule: tuple[float, ...] = (0.4, 0.4, 0.4, 0.2)
    steps: int = 500  # of fine-tuning after each pruning of the schedule
    distill_steps: int = 0  # for each degree that goes; 0: least squares alone, which is as good
    quantize_steps: int = 400  # under the packed model's numbers
    rate: float = 1.0  # learning rates, as a share of `trainable.REFINING`
    order: str = "distill-first"  # of ORDERS
    degree: int | None = None  # of the packed model; None: chosen by trials (`choice`)
    # Of `QUALITIES`; None: "balanced" of degree 2 and 3, of others chosen by trials for a target.
    quality: str | None = None
    target_ratio: float | None = None
    target_bytes: int | None = None  # of the packed model in memory
    target_psnr: float | None = None  # dB
    target_fps: float | None = None  # by the machine's cycle model
    max_drop: float | None = None  # dB
    seed: int = 0

    def __post_init__(self):
        def require(option: str, holds: bool, what: str):
            if not holds:
                raise InputError(f"{option}: {what}")

        rates = ", ".join(f"{rate:g}" for rate in self.schedule)
        shares = all(0 < rate < 1 for rate in self.schedule)
        require("--schedule", shares, f"{rates} is not in 0 … 1")
        for option in ("steps", "distill_steps", "quantize_steps"):
            value = getattr(self, option)
            require(f"--{option.replace('_', '-')}", value >= 0, f"{value} is below 0")
        require("--order", self.order in ORDERS, f"{self.order} is not one of {', '.join(ORDERS)}")
        require("--rate", 0 < self.rate <= 10, f"{self.rate:g} is not in 0 … 10")
        require("--degree", self.degree in (None, 0, 1, 2, 3), f"{self.degree} is not in 0 … 3")
        if self.quality is not None:
            names = ", ".join(QUALITIES)
            require("--quality", self.quality in QUALITIES, f"{self.quality} is none of {names}")
            stepped = self.quality in STEPPED
            degrees = f"is of models of degree {'2 and 3' if stepped else '0 and 1'}; name one by"
            fits = self.degree is not None and stepped == self.in_steps
            require("--quality", fits, f"{self.quality} {degrees} --degree")
        given = [option for option in TARGETS if getattr(self, TARGETS[option]) is not None]
        for option in given:
            value, least = getattr(self, TARGETS[option]), int(option == "--target-ratio")
            require(option, value > least, f"{value:g} is not over {least}")
        require(", ".join(given), len(given) < 2, "only one of them decides how much goes")

    @property
    def highest(self) -> int:
        """The degree at which distillation ends; where it is left open, that of compact models."""
        return COMPACT_DEGREE if self.degree is None else self.degree

    @property
    def targeted(self) -> bool:
        """True if a target decides how much goes: all prunings are one then, with the steps of
        all."""
        fields = set(TARGETS.values()) - {"max_drop"}
        return any(getattr(self, name) is not None for name in fields)

    @property
    def in_steps(self) -> bool:
        """True if the model is in steps, False if it is compact."""
        return self.highest > COMPACT_DEGREE

    @property
    def learning(self) -> Learning:
        """How learning rates fall, for the model's format."""
        return IN_STEPS if self.in_steps else IN_CODEBOOKS

    @property
    def packing(self) -> dict:
        """Degree and quality as `model.pack.pack.pack` takes them."""
        quality = STEPPED[0] if self.in_steps else COMPACT
        return {"sh_degree": self.highest, "quality": self.quality or quality}

    def check(self, scene: Scene, config: Config):
        """InputError if the model's degree is above that of the scene or of the machine."""
        machine = f"preset {config.name}"
        for owner, most in ((scene.name, scene.sh_degree), (machine, config.sh_degree)):
            if self.degree is not None and self.degree > most:
                raise InputError(f"{owner}: --degree {self.degree} is above its degree {most}")
