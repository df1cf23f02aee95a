"""The command `cycles`: cycles of a frame by stage, from the cycle model."""

from pathlib import Path

from splatcore.golden.pipeline import render
from splatcore.model.pack.pack import QUALITIES
from splatcore.sim.cli import options
from splatcore.sim.common.metric import against, decibels, differences
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.source import View, check_fits, check_known, note_unseen
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.machine.engines import truths
from splatcore.sim.packing.choose import packed_model, packing, packing_line
from splatcore.spec.config import CLOCK_HZ
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
    config = find_preset(preset)
    facts = {}
    for text in scene:
        with progress_bar(f"reading {text}"):
            source, view = View(text, size=size, file=camera).open()
            check_fits(config, view.width, view.height)
            model = packed_model(source, config, view, quality)
        with progress_bar(f"rendering {text}"):
            frame = render(config, model, view)
            metrics = against(differences(frame.pixels, truths(source, model, view)))
        note_unseen(source.name, view, frame.counts)
        found = frame_cycles(config, frame)
        facts[text] = found.by_name | {"fps": round(CLOCK_HZ / found.frame, 1)} | metrics
        if source.packed:
            console.print(f"{text}: {packing_line(source)}", soft_wrap=True)
            facts[text]["packing"] = packing(source)
    table = new_table("cycles / 1000", [Path(text).name.split(".")[0] for text in scene])
    for name in found.by_name:
        table.add_row(name, *(shown(row[name], ",.0f", 1000) for row in facts.values()))
    table.add_row("frames a second", *(f"{row['fps']:.1f}" for row in facts.values()))
    for name in TRUTHS:
        table.add_row(f"dB, {name}", *(decibels(row, name) for row in facts.values()))
    print_whole(table)
    write_json(json, {"preset": config.name, "scenes": facts})
