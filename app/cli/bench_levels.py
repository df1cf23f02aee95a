"""The command `bench levels`: cycles and error of a scene by level of detail."""

from pathlib import Path

from splatcore.app.cli import options
from splatcore.app.cli.options import command, option
from splatcore.sim.common.choice import numbers_within
from splatcore.sim.common.output import console, make_folder, write_json
from splatcore.spec.camera import LOD_MAX
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

AWAY_MAX = 1000  # median depths
FRAMES_MAX = 1000


@command("bench levels")
def levels_command(
    view: options.Viewing,
    scene: str = options.ONE_SCENE,
    output: Path = option(
        ..., options.FOLDER, "Folder for levels.json, levels.csv and two plots.", "-o", "--out"
    ),
    away: str = option(
        "0,1,3", "N,N,…", "Views: the camera is moved back by N median depths.", panel=options.SCENE
    ),
    pixels: str = option(
        "0.5,1,2,4", "PX,PX,…", "Errors in addition to 0; see --lod-pixels.", panel=options.MACHINE
    ),
    frames: int = option(
        0,
        "N",
        "Also render N frames from the first view to the last at each error, and print the largest "
        "change of a pixel between two frames.",
        min=0,
        max=FRAMES_MAX,
    ),
    quality: str | None = options.QUALITY,
    config: Config = options.PRESET,
):
    """Measure cycles and dB of a scene with levels of detail.

    Packs the scene with levels, moves its camera back, and renders each view by the golden model at
    each error. dB are against the reference's picture of all Gaussians; the same for as many
    Gaussians chosen at random. Cycles are those of the cycle model.
    """
    distances = dict.fromkeys(numbers_within("--away", away, 0, AWAY_MAX))
    errors = dict.fromkeys((0.0, *numbers_within("--pixels", pixels, 0, LOD_MAX)))
    if not config.levels:
        raise InputError(f"preset {config.name} renders no levels of detail")
    options.check_quality(quality, scene)
    shot = view.open(scene, config=config, quality=quality)
    shot.check_fits()
    if shot.source.scene is None:
        raise InputError(f"{scene}: is packed; bench levels needs the scene")
    from splatcore.study.bench import levels

    make_folder(output)
    found = levels.bench_levels(shot, [*distances], [*errors], frames, output)
    levels.table(found).print()
    if frames:
        levels.popping_table(found).print()
    write_json(output / "levels.json", found)
    console.print(str(output / "levels.json"))
