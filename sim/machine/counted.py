"""Expected counter values of a frame, from the golden model; counters of time are left out."""

from splatcore.golden.pipeline import Frame
from splatcore.golden.points import Points
from splatcore.spec.axi import LINE, port_beats, port_bytes
from splatcore.spec.config import Config
from splatcore.spec.packed import PackedModel
from splatcore.spec.work import FEATURE, SLOT


def point_counts(points: Points) -> dict[str, int]:
    """Expected counters of stages 0 and 1 after a frame."""
    return {
        "chunks": int(points.drawn.sum()),
        "skipped": int((points.drawn & ~points.read).sum()),
        "points": len(points.points),
        "front": len(points.front),
        "inside": len(points.inside),
        "projected": len(points.inside),
    }


def counted(config: Config, model: PackedModel, frame: Frame) -> dict[str, int]:
    """Expected values of the counters that do not depend on time."""
    points, binned = frame.points, frame.binned
    return {f"points_{name}": count for name, count in point_counts(points).items()} | {
        "bin_splats": len(points.index),
        "bin_kept": len(binned.kept),
        "bin_entries": len(binned.entries["key"]),
        "bin_bursts": len(binned.lists.address),
        "preprocessing_write_features": -(-len(binned.kept) * FEATURE // LINE)
        * LINE
        // port_bytes(config),
        "preprocessing_write_lists": (
            -(-config.burst * SLOT // port_bytes(config)) * len(binned.lists.address)
        ),
        "sort_entries": len(binned.entries["key"]),
    }


def attribute_beats(config: Config, model: PackedModel, frame: Frame) -> tuple[int, int]:
    """Minimum and maximum number of port beats in which attributes are read.

    A port wider than an attribute beat reads a beat shared by two neighbours once, if the second
    requests it in time.
    """
    beats = port_beats(config)
    first, count = model.attribute_bursts(frame.points.inside)
    last = first + count - 1
    most = (last // beats - first // beats + 1).sum()
    return most - (first[1:] // beats == last[:-1] // beats).sum(), most
