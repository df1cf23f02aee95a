"""Render, a frame's second half: work area in memory in, image in memory out."""

from splatcore.hdl.raster.render import Render
from splatcore.spec.axi import RENDERING
from splatcore.spec.config import TINY
from tb.helpers.frame_cases import frame_cases
from tb.helpers.on_bus import OnBus


def component() -> OnBus:
    return OnBus(TINY, RENDERING, Render(TINY))


def cases() -> dict[str, dict]:
    return {
        name: frame.numbers(frame.second_half(), frame.work_area(), frame.image())
        for name, frame in frame_cases().items()
    }
