"""A frame's parameters for the second half, and the names of its readers and writers."""

from amaranth.lib import data

from splatcore.hdl.lib.record import AREA, layout
from splatcore.hdl.memory.window import area_windows
from splatcore.spec.axi import BEAT_ADDRESS_BITS, BEAT_BITS, window_bits
from splatcore.spec.config import Config
from splatcore.spec.raster import colours
from splatcore.spec.record import Record
from splatcore.spec.work import STRIDE_BITS

READING = ("groups", "long_lists", "lists", "features")
WRITING = ("buckets", "pixels")  # names of its readers and writers in `spec.axi`, in that order


def job_layout(config: Config) -> data.StructLayout:
    """Layout of a frame's parameters for this half.

    Addresses and distances are in beats. `windows` (of its areas) is left out if all memory is one
    window, `rgba` (pixels have alpha; then the background is 0) if the machine has no register
    FORMAT.
    """
    areas = area_windows(config, READING, WRITING)
    windows = data.StructLayout(dict.fromkeys(areas, window_bits(config)))
    return data.StructLayout(
        {
            "width": range(config.side_max + 1),
            "height": range(config.side_max + 1),
            "background": layout(Record("colour", colours(config))),
            "area": AREA,
            "scratch": BEAT_ADDRESS_BITS,
            "pixels": BEAT_ADDRESS_BITS,
            "stride": STRIDE_BITS - BEAT_BITS,
        }
        | ({"windows": windows} if areas else {})
        | ({"rgba": 1} if config.rgba else {})
    )
