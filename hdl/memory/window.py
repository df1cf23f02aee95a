"""Windows of 4 GiB, where addresses have 64 bits: their numbers beside readers and writers."""

from amaranth.lib import data

from splatcore.spec.axi import READ_AREAS, WRITE_AREAS, window_bits
from splatcore.spec.config import Config


def client_windows(config: Config, readers: int, writers: int) -> dict[str, data.ArrayLayout]:
    """Layouts of the members `read_windows` and `write_windows`: a window's number for each reader
    and writer, for what it offers in this cycle; none where all memory is one window."""
    bits = window_bits(config)
    counts = {"read_windows": readers, "write_windows": writers} if bits else {}
    return {name: data.ArrayLayout(bits, count) for name, count in counts.items()}


def area_windows(config: Config, reading: tuple[str, ...], writing: tuple[str, ...]) -> list[str]:
    """Areas of these readers and writers that have windows; none where all memory is one window."""
    areas = [*map(READ_AREAS.get, reading), *map(WRITE_AREAS.get, writing)]
    return list(dict.fromkeys(areas)) if window_bits(config) else []
