"""The command `programs`: the microprograms and their schedules."""

from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.sim.cli.options import JsonOption, PresetOption, app
from splatcore.sim.common.output import check_writable, console
from splatcore.sim.common.paper import OPERATIONS, PES_BUSY
from splatcore.sim.common.result import write_json
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.microprogram import Program, operation_counts, program
from splatcore.spec.preset import find_preset
from splatcore.spec.programs import TEXTS
from splatcore.spec.schedule import pes, schedule

HEADINGS = "ops × + /√ choose PEs cycles latency busy regs".split()
"""Short names of `program_facts`, in its order."""

PAPER_OPERATIONS = (
    "The paper: {0[operations]} operations ({0[multiply]} ×, {0[add]} +, {0[divide]} /, "
    "{0[subtract]} −) without products with zeros, {1[operations]} with them ({1[multiply]} ×, "
    "{1[add]} +, {1[divide]} /, {1[subtract]} −); PEs busy {2:.1f} % of the cycles."
).format(OPERATIONS["without zeros"], OPERATIONS["with zeros"], 100 * PES_BUSY)


@app.command("programs")
def programs_command(
    show: Annotated[
        str | None, typer.Option(metavar="NAME", help="Print this program's steps and their times.")
    ] = None,
    preset: PresetOption = "DEFAULT",
    json: JsonOption = None,
):
    """List the microprograms of stages 0 and 1: operations, cycles, how busy the PEs are."""
    check_writable(json)
    config = find_preset(preset)
    if show is not None and show not in TEXTS:
        raise InputError(f"--show '{show}': unknown (there are {', '.join(TEXTS)})")
    facts = {name: program_facts(config, program(name)) for name in TEXTS}
    if show:
        plan = schedule(config, program(show))
        for place in plan.places:
            unit = (
                f"{place.step.unit}{place.number}" if place.step.unit == "pe" else place.step.unit
            )
            console.print(f"{place.time:4}  {unit:10}  {place.step}", soft_wrap=True)
    else:
        table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        table.add_column("program", no_wrap=True)
        for heading in HEADINGS:
            table.add_column(heading, justify="right", no_wrap=True)
        for name, row in facts.items():
            table.add_row(name, *map(str, row.values()))
        console.print(table)
        console.print(PAPER_OPERATIONS)
    write_json(json, {"preset": config.name, "programs": facts})


def program_facts(config: Config, steps: Program) -> dict[str, int | float]:
    """A program's operations and its schedule on a machine."""
    counts, plan = operation_counts(steps.steps), schedule(config, steps)
    return {
        "operations": sum(counts.values()),
        "multiply": counts.get("multiply", 0),
        "add": counts.get("add", 0),
        "divide_or_root": counts.get("reciprocal", 0) + counts.get("rsqrt", 0),
        "choose": counts.get("clamp", 0) + counts.get("maximum", 0),
        "pes": pes(config, steps),
        "cycles_an_item": plan.interval,
        "latency": plan.length,
        "pes_busy": round(plan.utilisation(pes(config, steps)), 3),
        "registers": plan.registers,
    }
