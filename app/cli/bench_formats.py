"""The command `bench formats`: other compressed formats of a scene against packed models."""

from splatcore.app.cli import bench
from splatcore.app.cli.options import (
    AntialiasedOption,
    AxesOption,
    NearOption,
    PresetOption,
    option,
)
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.sim.frame.reading import Reading
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

ToolOption = option(
    str | None, "PROGRAM", "PlayCanvas' splat-transform. Default: splat-transform on PATH."
)
ModelOption = option(
    list[str] | None, "MODEL", "Model that `compress` made from SCENE; may be repeated."
)


@bench.bench.command("formats")
def formats_command(
    output: bench.FolderOption,
    scene: bench.ScenesArgument = None,
    cameras: bench.CamerasOption = None,
    size: bench.PixelsOption = bench.SIZE,
    antialiased: AntialiasedOption = None,
    axes: AxesOption = None,
    near: NearOption = None,
    tool: ToolOption = None,
    model: ModelOption = None,
    preset: PresetOption = "DEFAULT",
    scheduler: bench.SchedulerOption = None,
):
    """Compare other file formats with packed models: bytes and dB.

    SOG, compressed PLY and SPZ are written by PlayCanvas' splat-transform (npm install -g
    @playcanvas/splat-transform), on the CPU. dB compare the reference renderer's 8-bit pictures
    with its pictures of the original scene. Writes DIR/formats.json; the files in each format stay
    in DIR.
    """
    if model and len(scene or ()) != 1:
        raise InputError("--model: goes with one SCENE")
    from splatcore.study.bench.formats import find_tool, formats

    path, config = find_tool(tool), find_preset(preset)
    views = bench.look(
        output, scene, cameras, size, [config], reading=Reading(antialiased, axes, near)
    )
    facts = formats(config, views, path, list(model or ()), output, scheduler)
    headings = "Gaussians|degree|MB in memory|MB of the file|times smaller|dB, scene".split("|")
    table = new_table("view", headings, "files against the original scene", ["format"])
    for row in facts["rows"]:
        table.add_row(
            f"{row['scene']} {row['camera']}", f"{row['gaussians']:,}", str(row["sh_degree"]),
            shown(row["bytes"], ".3f", 1e6), f"{row['file_bytes'] / 1e6:.3f}",
            f"{row['ratio']:.1f}", shown(row["psnr_db"], ".2f", none="∞"), row["format"],
        )  # fmt: skip
    print_whole(table)
    bench.finish(output / "formats.json", facts)
