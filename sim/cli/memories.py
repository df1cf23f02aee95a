"""The command `memories`: the on-chip memories, stage by stage."""

from collections import Counter

from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.hdl.stages import WHOLE
from splatcore.sim.cli.options import JsonOption, PresetOption, app
from splatcore.sim.common.output import check_writable, console
from splatcore.sim.common.paper import MEMORIES
from splatcore.sim.common.result import write_json
from splatcore.sim.eda.synth import memories
from splatcore.spec.config import KB
from splatcore.spec.preset import find_preset


@app.command("memories")
def memories_command(preset: PresetOption = "DEFAULT", json: JsonOption = None):
    """List the on-chip memories of each stage, beside the paper's five."""
    check_writable(json)
    config = find_preset(preset)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=f"preset {config.name}")
    for heading in ("stage", "words", "bits", "how many", "KB"):
        table.add_column(heading, justify="left" if heading == "stage" else "right")
    facts, total = {}, 0.0
    for name, parts in WHOLE.items():
        sizes = Counter(size for make in parts for size in memories(make(config)))
        facts[name] = [
            {"words": words, "bits": bits, "count": count} for (words, bits), count in sizes.items()
        ]
        for (words, bits), count in sizes.items():
            kilobytes = words * bits * count / 8 / KB
            total += kilobytes
            table.add_row(name, f"{words:,}", f"{bits:,}", str(count), f"{kilobytes:.2f}")
    table.add_row("all", "", "", "", f"{total:.2f}")
    console.print(table)
    paper = ", ".join(f"{name} {size}" for name, size in MEMORIES.items())
    console.print(f"The paper: {sum(MEMORIES.values())} KB ({paper}).")
    write_json(json, {"preset": config.name, "kilobytes": total, "stages": facts})
