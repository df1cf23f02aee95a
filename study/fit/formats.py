"""Number formats for `splatcore fit`: as few gates as the allowed error permits.

Mean squared errors of independent roundings add up. So the error that one bit less of a format
adds is measured once, on its own, and the error of a set of formats is predicted as a sum. Bits
are removed one at a time, always the bit that saves most gates per decibel, until no further one
fits. Full-size pictures then check the result: the last bits are restored if necessary, and
single bits are removed as long as the pictures allow it.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np

from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.metric import psnr_of_square
from splatcore.spec.preset import check_buildable
from splatcore.study.fit.gates import SHARES, bit_gates, bits_of, with_bits
from splatcore.study.fit.views import View

WIDER = 2
"""Bits that a format may have beyond DEFAULT's if needed: with 8-bit output even fewer are visible
(docs/architecture.md)."""

SEARCHED = 3  # views to search on: the ones with the largest errors
PIXELS = 480 * 270  # maximum size of these views: smaller ones have the same errors and less work

Progress = Callable[[str], None]  # called with the name of the step that begins


def decibels(square: float) -> float:
    """PSNR of a mean squared error; infinite for 0."""
    return float("inf") if square == 0 else psnr_of_square(square)


@dataclass(frozen=True)
class Step:
    """One bit less of a format. squares [V]: mean squared error that it adds on each view."""

    field: str
    bits: int
    squares: np.ndarray


class Search:
    """Search of the narrowest formats of one machine for some views.

    start: machine with the formats to begin with
    psnr: dB that every view must reach
    sized: machine with the final number of each part, for the gates that a bit saves
    less: PSNR of the worst view with one bit less, by format; no entry for a format that the
        hardware cannot have narrower
    """

    def __init__(
        self, start: Config, views: list[View], psnr: float, sized: Config, progress: Progress
    ):
        self.start, self.views, self.sized, self.progress = start, views, sized, progress
        self.fields, self.psnr, self.bound = list(SHARES), psnr, 10 ** (-psnr / 10)
        self.small = [smaller(view) for view in views]
        self.base = self._squares(self.small, start)
        self.full = self._squares(views, start)
        self.offset = np.zeros(len(views))
        self.steps: list[Step] = []
        self.added: dict[tuple[str, int], np.ndarray] = {}
        self.less: dict[str, float] = {}

    def without(self, fixed: tuple[str, ...]) -> "Search":
        """A new search from the start that keeps the `fixed` formats."""
        other = copy(self)
        other.fields = [field for field in self.fields if field not in fixed]
        other.offset, other.steps, other.less = np.zeros(len(self.views)), [], {}
        return other

    def with_view(self, view: View) -> "Search":
        """A new search from the start with one more view."""
        other = Search(self.start, [*self.views, view], self.psnr, self.sized, self.progress)
        other.fields = self.fields
        return other

    def _squares(self, views: list[View], config: Config) -> np.ndarray:
        return np.array([view.square(view.pixels(config)) for view in views])

    @property
    def config(self) -> Config:
        """The machine with the bits that remain."""
        config = self.start
        for step in self.steps:
            config = with_bits(config, step.field, step.bits)
        return config

    @property
    def forecast(self) -> np.ndarray:
        """Predicted mean squared errors [V] of its pictures."""
        return self.full + self.offset + sum(step.squares for step in self.steps)

    def run(self) -> Config:
        """Remove bits as long as the pictures allow; return the machine."""
        while step := self._next():
            self.steps.append(step)
        while ((truth := self._squares(self.views, self.config)) > self.bound).any():
            self.progress(f"restoring some of {len(self.steps)} bits")
            self.offset += truth - self.forecast
            self.steps.pop()
            while self.steps and (self.forecast > self.bound).any():
                self.steps.pop()
        fields = sorted(self.fields, key=lambda field: -bit_gates(self.sized, field))
        while any([self._shorten(field) for field in fields]):  # until no format can be shortened
            pass
        return self.config

    def _shorten(self, field: str) -> bool:
        """Remove bits of a format as long as full-size pictures allow; return whether any went."""
        before = len(self.steps)
        self.less.pop(field, None)
        while step := self._step(field):
            self.steps.append(step)
            self.progress(f"confirming {field} {step.bits}")
            truth = self._squares(self.views, self.config)
            if (truth > self.bound).any():
                self.steps.pop()
                self.less[field] = decibels(float(truth.max()))
                break
        return len(self.steps) > before

    def _step(self, field: str) -> Step | None:
        """The step to one bit less of a format; None if the hardware does not support it."""
        bits = bits_of(self.config, field) - 1
        if not built(self.config, field, bits):
            return None
        return Step(field, bits, self._adds(field, bits) - self._adds(field, bits + 1))

    def _next(self) -> Step | None:
        """The fitting step that saves most gates per decibel; None if no step fits."""
        now = self.forecast
        best, most = None, 0.0
        for field in self.fields:
            if not (step := self._step(field)):
                continue
            after = now + step.squares
            if (after > self.bound).any():
                continue
            cost = max(decibels(now.max()) - decibels(after.max()), LEAST)
            if (worth := bit_gates(self.sized, field) / cost) > most:
                best, most = step, worth
        return best

    def _adds(self, field: str, bits: int) -> np.ndarray:
        """Mean squared error [V] that a format of `bits` bits adds to the start's error.

        A format that cannot be combined with the start's other formats is measured with the
        current ones.
        """
        if bits == bits_of(self.start, field):
            return np.zeros(len(self.views))
        if (field, bits) not in self.added:
            self.progress(f"trying {field} {bits}")
            if alone := built(self.start, field, bits):
                added = self._squares(self.small, alone) - self.base
            else:
                pair = (self._squares(self.small, with_bits(self.config, field, b))
                        for b in (bits, bits + 1))  # fmt: skip
                added = next(pair) - next(pair) + self._adds(field, bits + 1)
            self.added[field, bits] = added
        return self.added[field, bits]


def built(config: Config, field: str, bits: int) -> Config | None:
    """A machine with a format of `bits` bits; None if the hardware does not support it."""
    try:
        found = with_bits(config, field, bits)
        check_buildable(found)
    except InputError:
        return None
    return found


def smaller(view: View) -> View:
    """The view with about `PIXELS` pixels, or as it is if it has fewer."""
    width, height = view.camera.width, view.camera.height
    scale = min((PIXELS / (width * height)) ** 0.5, 1.0)
    return view.resized(*(max(round(side * scale), 1) for side in (width, height)))


LEAST = 1e-3  # minimum cost of a bit, decibels


def wider(config: Config) -> Config:
    """The machine with every format as wide as may be tried."""
    for field in SHARES:
        for more in range(WIDER, 0, -1):
            if found := built(config, field, bits_of(config, field) + more):
                config = found
                break
    return config
