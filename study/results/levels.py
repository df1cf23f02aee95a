"""Results of `bench levels`: cycles and error of views by level of detail."""

from splatcore.study.results.fields import item, result, table
from splatcore.study.results.frames import MILLION, THOUSAND, camera, fps, preset, scene, size

DECIBELS = {"unit": "dB", "digits": 2, "examples": (30.5,)}


@result
class LevelsRow:
    """A view at a level of detail."""

    away: float = item(
        "how far the camera is moved back, in median depths of the nearest view", digits=2,
        title="moved back",
    )  # fmt: skip
    lod_pixels: float = item("`--lod-pixels`", "pixels", 3, title="error")
    gaussians: int = item("that are read, out of all levels", "k", 1, per=THOUSAND)
    share: float = item("of those read at 0 pixels", digits=3)
    frame_cycles: int = item("by the cycle model", "M cycles", 3, per=MILLION, title="frame")
    fps_at_800mhz: float = fps()
    cycles_share: float = item("of the cycles at 0 pixels", digits=3, title="share")
    psnr_db_scene: float | None = item(
        "of the golden model's picture against the reference's of the whole scene",
        title="PSNR, scene", none="exact", **DECIBELS,
    )  # fmt: skip
    psnr_db_finest: float | None = item(
        "against the golden model's picture at 0 pixels", title="PSNR, finest", none="exact",
        **DECIBELS,
    )  # fmt: skip
    psnr_db_decimated: float | None = item(
        "of the reference's picture of the same share of the scene's Gaussians, chosen at random "
        "and larger by √(1 / share), against the whole scene's; `null` for all of them",
        title="PSNR, decimated", **DECIBELS,
    )  # fmt: skip


@result
class Popping:
    """The path of frames at a level of detail."""

    lod_pixels: float = item("`--lod-pixels`", "pixels", 3, title="error")
    change_max: float = item(
        "largest change of a pixel's channel between two frames", "of 1", 4, title="largest change"
    )
    ratio: float = item("to the largest change at 0 pixels", digits=3)


@result
class Levels:
    """`levels.json`."""

    scene: str = scene()
    camera: str = camera()
    size: str = size()
    preset: str = preset()
    quality: str = item("how the scene is packed", examples=("compact",))
    gaussians: int = item("of the scene", "M", 3, per=MILLION)
    with_levels: int = item("of the model with levels", "M", 3, per=MILLION)
    bytes_ratio: float = item("of the model with levels to that without", "×", 3, title="bytes")
    clipped: int = item("coarser Gaussians that are larger than the formats can hold")
    rows: list[LevelsRow] = table("one for each view and error")
    frames: int = item("of the path from the nearest to the farthest view; 0: none")
    popping: list[Popping] = table("one for each error, with `--frames`", "popping")
