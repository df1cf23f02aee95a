"""Windows of 4 GiB, with addresses of 64 bits: the window number of each reader and writer."""

from amaranth.lib import data

from splatcore.spec.axi import READ_AREAS, WRITE_AREAS, window_bits
from splatcore.spec.config import Config


def client_windows(config: Config, readers: int, writers: int) -> dict[str, data.ArrayLayout]:
    """Layouts of the members `read_windows` and `write_windows`.

    They hold, for each reader and writer, the window of the burst it offers in this cycle. Empty if
    all memory is one window.
    """
    bits = window_bits(config)
    counts = {"read_windows": readers, "write_windows": writers} if bits else {}
    return {name: data.ArrayLayout(bits, count) for name, count in counts.items()}


def area_windows(config: Config, reading: tuple[str, ...], writing: tuple[str, ...]) -> list[str]:
    """Areas of these readers and writers that have windows; empty if all memory is one window."""
    areas = [*map(READ_AREAS.get, reading), *map(WRITE_AREAS.get, writing)]
    return list(dict.fromkeys(areas)) if window_bits(config) else []
