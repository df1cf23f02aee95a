"""Golden model of the whole machine: packed model and camera to 8-bit pixels, stage by stage."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from splatcore.golden.bin import PAGE_MAX, Binned, bin_splats
from splatcore.golden.points import Points, project_points
from splatcore.golden.raster import Entries, Raster, rasterize
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.packed import PackedModel
from splatcore.spec.renderable import check_format, check_renderable

STEPS = ("projecting", "binning", "sorting", "rasterizing")
"""Steps of `render`, in their order."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A rendered frame, and the result of each stage."""

    points: Points
    binned: Binned
    order: np.ndarray  # [E] entries of `binned`, group by group in the order of blending
    sorted: Entries  # the same entries in that order
    raster: Raster

    @property
    def start(self) -> np.ndarray:
        """First entry [groups + 1] of each group in `order`."""
        return self.sorted.start

    @property
    def lists(self) -> list[np.ndarray]:
        """Depth keys of each group's entries, in the order of its list in memory."""
        arrived = np.argsort(self.binned.group, kind="stable")
        return np.split(self.binned.entries["key"][arrived], self.start[1:-1])

    @property
    def pixels(self) -> np.ndarray:
        """The 8-bit image [H, W, 3], or [H, W, 4] with alpha and premultiplied colour."""
        return self.raster.pixels

    @property
    def counts(self) -> dict[str, int]:
        """Amounts of work of the frame, by name."""
        lengths = np.diff(self.start)
        tiles = np.bitwise_count(self.binned.entries["mask"])
        return {
            "points_read": len(self.points.step),
            "projected": len(self.points.inside),
            "splats": len(self.binned.kept),
            "tile_rows": self.binned.rows,
            "group_entries": len(self.order),
            "tile_pairs": int(tiles.sum()),
            "group_list_max": int(lengths.max(initial=0)),
        } | self.raster.counts


def render(
    config: Config,
    model: PackedModel,
    camera: Camera,
    background: tuple[int, int, int] = (0, 0, 0),
    rgba: bool = False,
    pages: int = PAGE_MAX,
    progress: Callable[[str], object] = str,
) -> Frame:
    """Render one frame.

    background: codes of `spec.colour.colour_format`, red, green, blue; ignored for `rgba`
    rgba: render with alpha (`spec.work`)
    pages: pages of list memory
    progress: called with each of `STEPS` as it begins
    Raises InputError for a model or a format that the machine does not render.
    """
    check_renderable(config, model)
    check_format(config, rgba)
    progress("projecting")
    points = project_points(config, model, camera, whole=False)
    progress("binning")
    size = camera.width, camera.height
    binned = bin_splats(config, points.codes, *size, pages)
    progress("sorting")
    order = np.lexsort((binned.entries["key"], binned.group))  # equal keys stay in arrival order
    start = np.searchsorted(binned.group[order], np.arange(len(binned.lists.count) + 1))
    entries = Entries(start, binned.entries["splat"][order], binned.entries["mask"][order])
    progress("rasterizing")
    raster = rasterize(config, binned.features, entries, size, background, rgba)
    return Frame(points, binned, order, entries, raster)
