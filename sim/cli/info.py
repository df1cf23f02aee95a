"""The command `info`: the contents of a scene or packed model."""

from splatcore.sim.cli.options import (
    JsonOption,
    SourceArgument,
    app,
)
from splatcore.sim.common import describe
from splatcore.sim.common.output import check_writable, console, progress_bar
from splatcore.sim.common.result import write_json
from splatcore.sim.common.source import open_source


@app.command("info")
def info_command(scene: SourceArgument, json: JsonOption = None):
    """Say what a scene or packed model holds: counts, extents, ranges, anything odd."""
    check_writable(json)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        facts = describe.describe(source)
    console.print(describe.table(facts))
    write_json(json, facts)
