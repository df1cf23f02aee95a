"""The command `bench coding`: bytes of model files by coding."""

from splatcore.app.cli import bench
from splatcore.app.cli.options import MACHINE, AntialiasedOption, AxesOption, PresetOption, option
from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import make_folder, progress_bar
from splatcore.sim.common.table import new_table, print_whole
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.source import check_source, scene_files
from splatcore.spec.preset import find_preset

QualitiesOption = option(
    str, "NAME,NAME,…", f"Packings to code, of {', '.join(QUALITIES)}.", "--quality", panel=MACHINE
)


@bench.bench.command("coding")
def coding_command(
    output: bench.FolderOption,
    scene: bench.ScenesArgument = None,
    antialiased: AntialiasedOption = None,
    axes: AxesOption = None,
    quality: QualitiesOption = "compact,faithful",
    preset: PresetOption = "DEFAULT",
):
    """Compare ways to code a packed model: bytes and time.

    Prints the size of the file in percent of the model in memory. Codings: the plain bytes by zstd
    or lzma; columns of codes by zstd, without and with differences of codes and copies of rows (as
    `pack` writes them); the same by an ideal range coder or lzma. Writes DIR/coding.json.
    """
    config, names = find_preset(preset), [name.strip() for name in quality.split(",")]
    check_known("--quality", QUALITIES, *names)
    reading = Reading(antialiased, axes)
    for text in scene or ():
        check_source(text, reading)
    scenes = list(scene or map(str, scene_files()))
    from splatcore.study.bench.coding import WAYS, coding

    make_folder(output)
    with progress_bar("coding") as advance:
        rows = coding(config, scenes, names, advance, reading)
    ways = [name.replace("_", " ") for name in WAYS]
    headings = ["bytes, memory", "file", *(f"{way}, %" for way in ways), "encode s", "decode s"]
    table = new_table("scene", headings, "of bytes in memory")
    for row in rows:
        shares = (f"{100 * size / row['bytes']:.1f}" for size in row["bytes_by_way"].values())
        seconds = (f"{row[f'{way}_seconds']:.2f}" for way in ("encode", "decode"))
        sizes = (f"{row[name]:,}" for name in ("bytes", "file_bytes"))
        table.add_row(f"{row['scene']} {row['quality']}", *sizes, *shares, *seconds)
    print_whole(table)
    bench.finish(output / "coding.json", {"preset": config.name, "rows": rows, "failed": []})
