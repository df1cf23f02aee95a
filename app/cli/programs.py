"""The command `programs`: microprograms and their schedules."""

from splatcore.app.cli.options import JsonOption, PresetOption, app, option
from splatcore.eda.paper import OPERATIONS, PES_BUSY
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, write_json
from splatcore.sim.common.table import new_table
from splatcore.spec.config import Config
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


ShowOption = option(str | None, "NAME", "Print the steps of this program and their times.")


@app.command("programs")
def programs_command(
    show: ShowOption = None, preset: PresetOption = "DEFAULT", json: JsonOption = None
):
    """List the microprograms of stage 0 (cull) and stage 1 (project).

    Prints the operations of each, its cycles per item, latency, registers and busy PEs.
    """
    config = find_preset(preset)
    facts = {name: program_facts(config, program(name)) for name in TEXTS}
    if show is not None:
        check_known("--show", TEXTS, show)
        plan = schedule(config, program(show))
        for place in plan.places:
            unit = place.step.unit + (str(place.number) if place.step.unit == "pe" else "")
            console.print(f"{place.time:4}  {unit:10}  {place.step}", soft_wrap=True)
    else:
        table = new_table("program", HEADINGS)
        for name, row in facts.items():
            table.add_row(name, *map(str, row.values()))
        console.print(table)
        console.print(PAPER_OPERATIONS)
    write_json(json, {"preset": config.name, "programs": facts})


def program_facts(config: Config, steps: Program) -> dict[str, int | float]:
    """Return a program's operations and its schedule on a machine."""
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
