"""Number formats for `splatcore fit`: as few gates as a picture's error leaves room for.

Errors of independent roundings add up as squares. So what a format with a bit less adds to a
picture's mean squared error is measured once, alone; what a set of formats will do is their sum.
Bits go one at a time, always the one that saves most gates for the decibels it costs, until no
further one fits. Pictures of full size then progress the truth: the last bits come back if they have
to, and single ones go until none can go any more.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np

from splatcore.sim.fit.gates import SHARES, bit_gates, bits_of, with_bits
from splatcore.sim.fit.views import View
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.metric import psnr_of_square
from splatcore.spec.preset import check_buildable

WIDER = 2
"""Bits that each format may have more than DEFAULT's if that is needed: behind 8-bit output even
fewer show (docs/architecture.md)."""

SEARCHED = 3  # views on which formats are tried one by one: those of the largest errors
PIXELS = 480 * 270  # of these views meanwhile, if they have more: errors are the same, work is not

Progress = Callable[[str], None]


def decibels(square: float) -> float:
    """PSNR of a mean squared error; infinite for 0."""
    return float("inf") if square == 0 else psnr_of_square(square)


@dataclass(frozen=True)
class Step:
    """A bit less of a format. squares [V]: mean squared error that it adds on each view."""

    field: str
    bits: int
    squares: np.ndarray


class Search:
    """Formats of one machine for some views.

    sized: a machine that has as many of each part as this one is to have. less: PSNR of the worst
    view's picture with a bit less, by format; nothing for those that are as narrow as they are
    built.
    """

    def __init__(self, start: Config, views: list[View], psnr: float, sized: Config, progress: Progress):
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
        """The same from the start, with formats that stay."""
        other = copy(self)
        other.fields = [field for field in self.fields if field not in fixed]
        other.offset, other.steps, other.less = np.zeros(len(self.views)), [], {}
        return other

    def with_view(self, view: View) -> "Search":
        """The same from the start, with a view more."""
        other = Search(self.start, [*self.views, view], self.psnr, self.sized, self.progress)
        other.fields = self.fields
        return other

    def _squares(self, views: list[View], config: Config) -> np.ndarray:
        return np.array([view.square(view.pixels(config)) for view in views])

    @property
    def config(self) -> Config:
        """The machine with the bits that are left."""
        config = self.start
        for step in self.steps:
            config = with_bits(config, step.field, step.bits)
        return config

    @property
    def forecast(self) -> np.ndarray:
        """Mean squared errors [V] of its pictures."""
        return self.full + self.offset + sum(step.squares for step in self.steps)

    def run(self) -> Config:
        """Take bits away as long as the pictures allow; returns the machine."""
        while step := self._next():
            self.steps.append(step)
        while ((truth := self._squares(self.views, self.config)) > self.bound).any():
            self.progress(f"taking some of {len(self.steps)} bits back")
            self.offset += truth - self.forecast
            self.steps.pop()
            while self.steps and (self.forecast > self.bound).any():
                self.steps.pop()
        fields = sorted(self.fields, key=lambda field: -bit_gates(self.sized, field))
        while any([self._shorten(field) for field in fields]):  # what one saves, another may use
            pass
        return self.config

    def _shorten(self, field: str) -> bool:
        """Take bits of a format away as long as the true pictures allow; whether any went."""
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
        """A bit less of a format; None if it is not built so narrow."""
        bits = bits_of(self.config, field) - 1
        if not built(self.config, field, bits):
            return None
        return Step(field, bits, self._adds(field, bits) - self._adds(field, bits + 1))

    def _next(self) -> Step | None:
        """The step that saves most gates for each decibel it costs, of those that fit."""
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
        """Mean squared error [V] that a format of so many bits adds to the start's.

        What cannot be built beside the start's other formats is measured beside the present ones.
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
    """A machine with a format of so many bits; None if the hardware cannot be made of it."""
    try:
        found = with_bits(config, field, bits)
        check_buildable(found)
    except InputError:
        return None
    return found


def smaller(view: View) -> View:
    """A view with about `PIXELS`."""
    width, height = view.camera.width, view.camera.height
    scale = min((PIXELS / (width * height)) ** 0.5, 1.0)
    return view.resized(*(max(round(side * scale), 1) for side in (width, height)))


LEAST = 1e-3  # decibels that any bit is taken to cost at least


def wider(config: Config) -> Config:
    """A machine with the most bits that are tried."""
    for field in SHARES:
        for more in range(WIDER, 0, -1):
            if found := built(config, field, bits_of(config, field) + more):
                config = found
                break
    return config
