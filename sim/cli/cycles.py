"""The command `cycles`: cycles of a frame by stage, from the cycle model."""

from itertools import takewhile
from pathlib import Path

from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.cli import options
from splatcore.sim.common.metric import against, decibels, differences
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.source import Source, View, check_fits, check_known, note_unseen
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.spec.camera import Camera
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.preset import find_preset

TRUTHS = ("machine", "scene")

SceneArgument = options.argument(list[str], "SCENE|MODEL …", "What to render.")


@options.app.command("cycles")
def cycles_command(
    scene: SceneArgument,
    camera: options.CameraOption = None,
    size: options.SizeOption = None,
    preset: options.PresetOption = "DEFAULT",
    quality: options.QualityOption = None,
    json: options.JsonOption = None,
):
    """Cycles of a frame by stage, from the golden model's counts, and the error of its picture,
    against the reference on the same packed model (machine) and on the scene as it is (scene).

    The cycle model agrees with the RTL within 3 % for each stage by itself; its halves have
    LPDDR4's latency in them, its bandwidth is left out.
    """
    if quality is not None:
        check_known("--quality", QUALITIES, quality)
    config, facts = find_preset(preset), {}
    for text in scene:
        with progress_bar(f"reading {text}"):
            source, view = View(text, size=size, file=camera).open()
            check_fits(config, view.width, view.height)
        facts[text] = measured(config, source, view, quality)
    table = new_table("cycles / 1000", [Path(text).name.split(".")[0] for text in scene])
    for name in takewhile(lambda key: key != "fps", next(iter(facts.values()))):
        table.add_row(name, *(shown(row[name], ",.0f", 1000) for row in facts.values()))
    table.add_row("frames a second", *(f"{row['fps']:.1f}" for row in facts.values()))
    for name in TRUTHS:
        table.add_row(f"dB, {name}", *(decibels(row, name) for row in facts.values()))
    print_whole(table)
    write_json(json, {"preset": config.name, "scenes": facts})


def measured(config: Config, source: Source, view: Camera, quality: str | None) -> dict:
    """A picture's cycles by stage, frames a second, errors and, of a scene, how it was packed."""
    from splatcore.golden.pipeline import render
    from splatcore.sim.cycles.frame import frame_cycles
    from splatcore.sim.machine.engines import truths
    from splatcore.sim.packing.choose import packed_model, packing, packing_line

    with progress_bar(f"packing {source.name}"):
        model = packed_model(source, config, view, quality)
    with progress_bar(f"rendering {source.name}"):
        frame = render(config, model, view)
    metrics = against(differences(frame.pixels, truths(source, model, view)))
    note_unseen(source.name, view, frame.counts)
    found = frame_cycles(config, frame)
    facts = found.by_name | {"fps": round(CLOCK_HZ / found.frame, 1)} | metrics
    if source.packed:
        console.print(f"{source.name}: {packing_line(source)}", soft_wrap=True)
        facts["packing"] = packing(source)
    return facts
