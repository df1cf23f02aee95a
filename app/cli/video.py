"""Videos: frames, uint8 [H, W, 3], as H.264 in an MP4 file."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from splatcore.sim.common.output import whole_file
from splatcore.spec.error import InputError

QUALITY = {"crf": "12", "preset": "medium"}
"""Options of x264: rendered scenes at 12 look the same as the PNG files."""

BT709 = 1  # code of the matrix, primaries and transfer of HD video, in H.264 and in FFmpeg
LIMITED = 1  # code of levels 16 … 235


def check_encoder():
    """Raise InputError unless PyAV is installed."""
    if find_spec("av") is None:
        raise InputError("--video: needs PyAV: pip install 'splatcore[video]'")


@contextmanager
def video(path: Path, rate: int) -> Iterator[Callable[[np.ndarray], None]]:
    """Yield a function that adds frames, uint8 [H, W, 3], all of one size; write the file at the
    end, or none after a failure.

    rate: frames per second

    Colours have half the resolution (yuv420p), which all players support; odd sides are padded by
    repeating the last row or column.
    """
    import av

    with whole_file(path) as part, av.open(str(part), "w", format="mp4") as file:
        stream = file.add_stream("libx264", rate=rate, options=QUALITY)
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.colorspace = context.color_primaries = context.color_trc = BT709
        context.color_range = LIMITED

        def add(pixels: np.ndarray):
            odd = [(0, side % 2) for side in pixels.shape[:2]]
            whole = np.ascontiguousarray(np.pad(pixels, [*odd, (0, 0)], mode="edge"))
            if not context.is_open:
                stream.height, stream.width = whole.shape[:2]
            frame = av.VideoFrame.from_ndarray(whole, format="rgb24")
            file.mux(stream.encode(frame.reformat(format="yuv420p", dst_colorspace=BT709)))

        yield add
        file.mux(stream.encode())
