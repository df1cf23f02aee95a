"""The options of a compression: one value for each decision of the user."""

from dataclasses import dataclass

from splatcore.model.pack.quality import COMPACT, QUALITIES, STEPPED
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.memory import COMPACT_DEGREE
from splatcore.spec.scene import Scene

ORDERS = ("distill-first", "prune-first")
"""Harmonics are reduced before Gaussians are pruned, or after it as in the paper. If before,
Gaussians are fine-tuned as the machine will show them; if after, distillation takes fewer steps."""

TARGETS = {
    "--target-ratio": "target_ratio", "--target-bytes": "target_bytes",
    "--target-psnr": "target_psnr", "--target-fps": "target_fps", "--max-drop": "max_drop",
}  # fmt: skip
"""Options that decide how much is removed → fields of a recipe."""


@dataclass(frozen=True)
class Learning:
    """Decay of the learning rates of a compression, as shares of the initial rates.

    A model in codebooks continues under its number formats with the rates at the end of
    fine-tuning. In a model in steps rounding moves less: its fine-tuning decays further, and
    learning under its number formats restarts with higher rates, but not the initial ones, with
    which a scene loses more than it gains (docs/notes/2026-11-compression.md).
    """

    left: float  # at the end of fine-tuning
    numbers: float  # at the start of quantisation
    last: float = 0.02  # at the end of quantisation, as a share of its start


IN_CODEBOOKS, IN_STEPS = Learning(0.3, 0.3), Learning(0.03, 0.2)


@dataclass(frozen=True)
class Recipe:
    """Options of a compression; raises InputError naming the option of an invalid value.

    At most one target may be given. It decides how many Gaussians are removed: in one pruning,
    with the steps of all prunings of the schedule. With `max_drop`, pruning continues at the
    schedule's rates until the loss on held-out views would exceed it.
    """

    schedule: tuple[float, ...] = (0.4, 0.4, 0.4, 0.2)  # shares of the Gaussians to remove
    steps: int = 500  # of fine-tuning after each pruning of the schedule
    distill_steps: int = 0  # per degree that is removed; 0: least squares alone, which is as good
    quantize_steps: int = 400  # under the packed model's number formats
    rate: float = 1.0  # learning rates, as a share of `trainable.REFINING`
    order: str = "distill-first"  # of ORDERS
    degree: int | None = None  # of the packed model; None: chosen by trials (`choice`)
    # Of `QUALITIES`; None: "balanced" for degrees 2 and 3, else chosen by trials for a target.
    quality: str | None = None
    target_ratio: float | None = None  # bytes of the scene's PLY over bytes of the packed model
    target_bytes: int | None = None  # of the packed model in memory
    target_psnr: float | None = None  # dB on held-out views
    target_fps: float | None = None  # of the packed model, by the machine's cycle model
    max_drop: float | None = None  # dB on held-out views
    seed: int = 0

    def __post_init__(self):
        def require(option: str, holds: bool, fault: str):
            if not holds:
                raise InputError(f"{option}: {fault}")

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
            require("--quality", self.quality in QUALITIES, f"{self.quality} is not one of {names}")
            stepped = self.quality in STEPPED
            degrees = f"needs --degree {'2 or 3' if stepped else '0 or 1'}"
            fits = self.degree is not None and stepped == self.in_steps
            require("--quality", fits, f"{self.quality} {degrees}")
        given = [option for option in TARGETS if getattr(self, TARGETS[option]) is not None]
        for option in given:
            value, least = getattr(self, TARGETS[option]), int(option == "--target-ratio")
            require(option, value > least, f"{value:g} is not above {least}")
        require(", ".join(given), len(given) < 2, "give only one of these")

    @property
    def highest(self) -> int:
        """The degree at which distillation ends; if left open, the degree of compact models."""
        return COMPACT_DEGREE if self.degree is None else self.degree

    @property
    def targeted(self) -> bool:
        """True if a target decides how much is removed: then there is one pruning, with the steps
        of all."""
        fields = set(TARGETS.values()) - {"max_drop"}
        return any(getattr(self, name) is not None for name in fields)

    @property
    def in_steps(self) -> bool:
        """True if the model is in steps, False if it is in codebooks."""
        return self.highest > COMPACT_DEGREE

    @property
    def learning(self) -> Learning:
        """Decay of the learning rates for the model's format."""
        return IN_STEPS if self.in_steps else IN_CODEBOOKS

    @property
    def packing(self) -> dict:
        """Degree and quality as keyword arguments of `model.pack.pack.pack`."""
        quality = STEPPED[0] if self.in_steps else COMPACT
        return {"sh_degree": self.highest, "quality": self.quality or quality}

    def check(self, scene: Scene, config: Config):
        """Raise InputError if the scene or the machine has a lower degree than the model."""
        machine = f"preset {config.name}"
        for owner, most in ((scene.name, scene.sh_degree), (machine, config.sh_degree)):
            if self.degree is not None and self.degree > most:
                raise InputError(f"{owner}: --degree {self.degree} is above its degree {most}")
