"""The command `hard`: the hard cases through an engine, each with a bound on its error."""

from pathlib import Path

from splatcore.app.cli import options
from splatcore.app.cli.commands import COMMANDS
from splatcore.app.cli.options import MACHINE, argument, listed, option
from splatcore.app.cli.simulate import TIMING
from splatcore.model.generate.hard import HARD
from splatcore.model.generate.hard_case import PSNR_MIN
from splatcore.model.generate.hard_colour import ANTIALIASED
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, messages, progress_bar
from splatcore.sim.frame.shot import ENGINES
from splatcore.sim.frame.size import parse_size
from splatcore.sim.frame.source import check_fits
from splatcore.sim.machine.script import LPDDR4, find_timing
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

SIZE = options.Viewing.__dataclass_fields__["size"]


@options.command(
    "hard",
    help=f"{COMMANDS['hard'].summary}\n\n"
    "Prints, for each case, the error against the float64 reference on the same packed model and "
    "on the original scene, the loss of packing, cycles (golden: by the cycle model, rtl: "
    "measured) and the Gaussians left out. A case passes with "
    f"{PSNR_MIN:.0f} dB against the reference under the machine's faintness rule; with harmonics "
    "packing has a bound, too; with rtl the picture must be the golden model's to the bit. Exit "
    "status 1 if a case fails (the FP16 numbers of PAPER fail some)."
    "\n\nNAME is one of: " + ", ".join(HARD) + ".",
)
def hard_command(
    name: str | None = argument(None, "NAME", "Case to run. Default: all."),
    engine: str = option("golden", "NAME", f"{listed(ENGINES)}.", panel=MACHINE),
    config: Config = options.PRESET,
    size: str | None = SIZE,
    timing: str = TIMING,
    output: Path | None = option(None, "DIR", "Folder for the pictures and a contact sheet."),
) -> dict:
    check_known("--engine", ENGINES, engine)
    memory = find_timing(timing)
    left_out = () if config.compensates else ANTIALIASED
    names = [name] if name is not None else [case for case in HARD if case not in left_out]
    check_known("hard case", HARD, *names)
    if name is None and left_out:
        text = (
            f"preset {config.name} does not compensate opacities; left out: {', '.join(left_out)}"
        )
        messages.print(text, soft_wrap=True)
    if engine != "rtl" and memory is not LPDDR4:
        raise InputError("--timing: goes with --engine rtl")
    shape = parse_size(size) if size else None

    from splatcore.sim.machine.path import build
    from splatcore.study.bench.hard_cases import camera_of, measure
    from splatcore.study.bench.hard_output import pass_line, table, write_pictures

    if engine != "reference":
        for case in names:
            camera = camera_of(HARD[case](), shape)
            check_fits(config, camera.width, camera.height)
    machine = build(config) if engine == "rtl" else None
    outcomes = []
    for number, case in enumerate(names):
        with progress_bar(f"{case} by {engine}", len(names)) as advance:
            advance(number, len(names))
            outcomes.append(measure(case, engine, config, shape, machine, memory))
        console.print(pass_line(outcomes[-1]))
    table(outcomes, f"{engine}, preset {config.name}").print()
    failed = [outcome.name for outcome in outcomes if not outcome.passed]
    console.print(
        f"{len(outcomes) - len(failed)} of {len(outcomes)} pass"
        + (f"; not: {', '.join(failed)}" if failed else "")
    )
    if output:
        write_pictures(output, outcomes, engine)
    facts = {
        "engine": engine, "preset": config.name, "timing": memory.name if machine else None,
        "passed": not failed, "cases": {outcome.name: outcome.facts() for outcome in outcomes},
    }  # fmt: skip
    return options.result(facts, failed)
