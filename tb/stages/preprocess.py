"""Preprocess, a frame's first half: packed model in memory in, work area in memory out."""

from splatcore.hdl.points.preprocess import Preprocess
from splatcore.spec.axi import PREPROCESSING
from splatcore.spec.config import TINY
from tb.helpers.frame_cases import frame_cases
from tb.helpers.on_bus import OnBus


def component() -> OnBus:
    return OnBus(TINY, PREPROCESSING, Preprocess(TINY))


def cases() -> dict[str, dict]:
    return {
        name: frame.numbers(frame.first_half(), frame.model(), frame.work_area())
        for name, frame in frame_cases().items()
    }
