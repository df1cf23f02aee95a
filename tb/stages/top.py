"""The whole machine between a host and memory: packed models in, images out; with frames in a row
two are in flight."""

from functools import partial

from splatcore.hdl.top import Top
from splatcore.spec.config import TINY
from tb.helpers.frame_cases import frame_cases

component = partial(Top, TINY)


def cases() -> dict[str, dict]:
    return {
        name: frame.numbers({}, frame.model(), frame.image())
        for name, frame in frame_cases().items()
    }
