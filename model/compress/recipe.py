"""The options of a compression: one value for each decision that a user may take."""

from dataclasses import dataclass

from splatcore.spec.error import InputError

ORDERS = ("distill-first", "prune-first")
"""Harmonics go before Gaussians, or after them as in the paper. Gaussians merged later are
fine-tuned as the machine will show them; harmonics distilled later cost fewer steps."""


@dataclass(frozen=True)
class Recipe:
    """Options of a compression. InputError names the option of a value that cannot be.

    A pruning rate is the share of the Gaussians that a step removes. With `target_ratio` the rates
    are scaled together so that the packed model has that ratio to the scene's PLY; with `max_drop`
    pruning ends where the loss on the views kept aside would pass it.
    """

    schedule: tuple[float, ...] = (0.4, 0.4, 0.4, 0.2)
    steps: int = 500  # of fine-tuning after each pruning
    distill_steps: int = 400  # for each degree that goes
    quantize_steps: int = 400  # under the packed model's numbers
    rate: float = 1.0  # learning rates, as a share of `trainable.REFINING`
    order: str = "distill-first"  # of ORDERS
    sh_degree: int | None = None  # of the packed model; None: by what view dependence is worth
    target_ratio: float | None = None
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
        require("--sh-degree", self.sh_degree in (None, 0, 1), f"{self.sh_degree} is not 0 or 1")
        if self.target_ratio is not None:
            require("--target-ratio", self.target_ratio > 1, f"{self.target_ratio:g} is not over 1")
        if self.max_drop is not None:
            require("--max-drop", self.max_drop > 0, f"{self.max_drop:g} dB is not over 0")
        both = self.target_ratio is not None and self.max_drop is not None
        require("--target-ratio, --max-drop", not both, "only one of them decides how much goes")
