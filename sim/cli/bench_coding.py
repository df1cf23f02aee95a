"""The command `bench coding`: bytes of model files by the way of coding."""

from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.cli import bench
from splatcore.sim.cli.options import AntialiasedOption, AxesOption, PresetOption, option
from splatcore.sim.common.output import make_folder, progress_bar
from splatcore.sim.common.reading import Reading
from splatcore.sim.common.source import check_known, check_source, scene_files
from splatcore.sim.common.table import new_table, print_whole
from splatcore.spec.preset import find_preset

QualitiesOption = option(str, "NAME,NAME,…", f"Of {', '.join(QUALITIES)}.", "--quality")


@bench.bench.command("coding")
def coding_command(
    output: bench.FolderOption,
    scene: bench.ScenesArgument = None,
    antialiased: AntialiasedOption = None,
    axes: AxesOption = None,
    quality: QualitiesOption = "compact,faithful",
    preset: PresetOption = "DEFAULT",
):
    """Bytes of a model's file against those in memory, for each way to code it.

    In percent of memory: its bytes as they are in zstd or lzma; columns of codes in zstd, without
    and with differences of codes and copies of rows; with both, which is the file that `pack`
    writes, an ideal range coder of bytes or lzma in place of zstd. Writes DIR/coding.json.
    """
    config, names = find_preset(preset), [name.strip() for name in quality.split(",")]
    check_known("--quality", QUALITIES, *names)
    reading = Reading(antialiased, axes)
    for text in scene or ():
        check_source(text, reading)
    scenes = list(scene or map(str, scene_files()))
    from splatcore.sim.bench.coding import WAYS, coding

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
