"""The command `synth`: size and depth of the machine's parts."""

from dataclasses import dataclass
from pathlib import Path

from splatcore.app.cli.options import FOLDER, PRESET, command, listed, option, result
from splatcore.eda import paper
from splatcore.eda.gates.machine_gates import synthesise_machine
from splatcore.eda.gates.synth import DEPTH_MAX, gates
from splatcore.hdl.stages import CONTROL, PRIMITIVES, STAGES
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

PARTS = STAGES | CONTROL | PRIMITIVES

CELLS = "Standard cells"


@dataclass(frozen=True)
class Cells:
    """The options of mapping to standard cells."""

    liberty: str | None = option(
        None,
        "FILE",
        "Map to the cells of a library (.lib, .lib.gz): area and longest paths.",
        panel=CELLS,
    )
    process: float | None = option(
        None, "NM", "Process of the library, for scaling its area to 28 nm.", min=1.0, panel=CELLS
    )
    check: bool = option(
        False,
        None,
        "With --liberty: prove that each netlist of cells is equivalent to its RTL.",
        panel=CELLS,
    )
    no_clock_gates: bool = option(
        False,
        None,
        "With --liberty: leave out clock gates, which hold registers that are not enabled.",
        panel=CELLS,
    )
    route: bool = option(
        False,
        None,
        "With --liberty: place and route each part (Debian's graywolf and qrouter).",
        panel=CELLS,
    )
    lef: str | None = option(
        None,
        "TECH,CELLS",
        "With --route: LEF files of the technology and of the cells.",
        panel=CELLS,
    )

    def check_given(self, output: Path | None):
        """Raise InputError, naming the option, if one lacks the option that it goes with."""
        given = {
            f"-o {output}": output,
            f"--process {self.process}": self.process,
            "--check": self.check or None,
            "--no-clock-gates": self.no_clock_gates or None,
            "--route": self.route or None,
        }
        for words, value in given.items():
            if value is not None and self.liberty is None:
                raise InputError(f"{words}: goes with --liberty only")
        if self.route != (self.lef is not None):
            raise InputError("--route and --lef go together")


@command("synth")
def synth_command(
    cells: Cells,
    stage: list[str] = option(..., "NAME", f"Part; may be repeated: top, {listed(PARTS)}."),
    config: Config = PRESET,
    output: Path | None = option(
        None, FOLDER, "With --liberty: write netlists of cells, and scripts for OpenSTA."
    ),
) -> dict:
    """Synthesise stages or primitives; print their size and depth.

    Size is in NAND2-equivalents, with flip-flops, without memories (listed in bits). Depth is the
    number of gates on the longest path between registers; as a rough guide, 800 MHz in 28 nm allows
    40, but only --liberty shows whether a clock is met. Each part is mapped for area and for speed.

    With --liberty: area in um² and the library's NAND2-equivalents; the longest path in ps and FO4
    (delay of an inverter that drives four), with its cells and end points, without and with wires.
    Assumptions: docs/silicon.md. With --check the exit status is 1 if a bit of a netlist is not
    proven equal to the RTL's; simulations of netlists against the golden model are tests.

    With --route each part (up to some 6,600 cells) is placed and routed: length and capacitance of
    its wires by fan-out, the longest path with their resistance and capacitance by OpenSTA, and
    with -o a picture of each layout.

    top is the whole machine, part by part, checked for latches, loops, and wires with several
    drivers or none; with --liberty paths cross parts. The first run takes up to half an hour; parts
    are cached (see `splatcore cache`).
    """
    check_known("--stage", ("top", *PARTS), *stage)
    cells.check_given(output)
    facts = {"preset": config.name}
    if liberty := cells.liberty:
        from splatcore.eda.cells.silicon_tables import print_silicon

        gated = not cells.no_clock_gates
        facts |= print_silicon(config, stage, liberty, cells.process, output, cells.check, gated)
        if cells.lef is not None:
            from splatcore.eda.route.route_tables import print_routes

            facts["route"] = print_routes(config, stage, liberty, cells.lef, output)
    else:
        if parts := [name for name in stage if name != "top"]:
            facts["stages"] = _synthesise_parts(config, parts)
        if "top" in stage:
            facts["top"] = synthesise_machine(config)
    return result(facts, any(each["difference"] for each in facts.get("check", {}).values()))


COLUMNS = [Column("stage")] + [
    Column(name, digits=0, get=key)
    for name, key in (
        ("NAND2", "nand2"), ("paper", "paper_nand2"), ("depth", "depth"),
        ("for speed", "speed_nand2"), ("depth", "speed_depth"), ("flip-flops", "flip_flops"),
        ("memory bits", "memory_bits"),
    )
]  # fmt: skip


def _synthesise_parts(config: Config, names: list[str]) -> dict:
    """Synthesise and print single parts; return the numbers for JSON."""
    facts = {}
    for name in names:
        with progress_bar(f"synthesising {name}"):
            found = gates(PARTS[name](config))
        nand2 = paper.GATES.get(paper.STAGE_OF.get(name))
        facts[name] = vars(found) | {"memory_bits": found.memory_bits, "paper_nand2": nand2}
    title = f"preset {config.name}; depth for speed ≤ {DEPTH_MAX}"
    rows = ({"stage": name} | each for name, each in facts.items())
    Table.of("synth", title, COLUMNS, rows).print()
    return facts
