"""What tools want to know about the generated Verilog: memories, a core file, constraints."""

import csv
from collections.abc import Iterable
from importlib.metadata import version
from io import StringIO

from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.sim.eda.macros import memory_name
from splatcore.spec.config import CLOCK_HZ, KB, Config

CORE = """\
CAPI=2:
# FuseSoC: `fusesoc --cores-root . run --target lint splatcore`
name: "splatcore:ip:splatcore:{version}"
description: "Splatcore, preset {preset}: an accelerator for 3D Gaussian Splatting"

filesets:
  rtl:
    files:
{files}
    file_type: verilogSource
  waivers:
    files:
      - {waivers}: {{file_type: vlt}}
  constraints:
    files:
      - splatcore.sdc: {{file_type: SDC}}

targets:
  default: &default
    filesets: [rtl]
    toplevel: {top}
  lint:
    <<: *default
    filesets: [waivers, rtl]
    default_tool: verilator
    tools:
      verilator:
        mode: lint-only
        verilator_options: [-Wall]
  synth:
    <<: *default
    filesets: [rtl, constraints]
    default_tool: yosys
    tools:
      yosys:
        arch: xilinx
"""

CONSTRAINTS = """\
# Splatcore, preset {preset}: an example, to be adapted. Times in ns. Generated; Apache-2.0.

# {megahertz:g} MHz. Setup, skew and jitter take about a tenth of the period.
create_clock -name clk -period {period:g} [get_ports clk]
set_clock_uncertainty {uncertainty:g} [get_clocks clk]

# The bus has half the period on its side of the ports, the machine the other half. Most ports begin
# or end at registers.
set inputs [get_ports {{{inputs}}}]
set outputs [get_ports {{{outputs}}}]
set_input_delay {half:g} -clock clk $inputs
set_output_delay {half:g} -clock clk $outputs

# rst is synchronous and active high. It is timed like any other input and is no false path: all
# registers have to leave reset in the same cycle. Drive it from a register of this clock; hold it
# for {reset} cycles or more.
set_input_delay {half:g} -clock clk [get_ports rst]
"""

RESET_CYCLES = 2


def memory_list(shapes: list[tuple[int, int]], instances: Iterable[tuple[str, str]]) -> str:
    """Memories as CSV: module, words, bits, ports, how many there are, which instances.

    instances: (path, module) of all modules of the machine.
    """
    places: dict[str, list[str]] = {memory_name(*shape): [] for shape in shapes}
    for path, module in instances:
        if module in places:
            places[module].append(path)
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("module", "words", "bits", "ports", "count", "kilobytes", "instances"))
    for words, bits in shapes:
        paths = places[memory_name(words, bits)]
        kilobytes = f"{words * bits * len(paths) / 8 / KB:.3f}"
        row = (words, bits, "1 write, 1 read", len(paths), kilobytes, " ".join(paths))
        table.writerow((memory_name(words, bits), *row))
    return text.getvalue()


def core(config: Config, top: str, sources: list[str], waivers: str) -> str:
    """A core file for FuseSoC."""
    files = "\n".join(f"      - {name}" for name in sources)
    facts = {"version": version("splatcore"), "preset": config.name, "top": top}
    return CORE.format(**facts, files=files, waivers=waivers)


def constraints(config: Config, component: wiring.Component) -> str:
    """Constraints for synthesis and timing at `CLOCK_HZ`."""
    ports: dict[bool, list[str]] = {True: [], False: []}
    for path, member, _ in component.signature.flatten(component):
        ports[member.flow == In].append("__".join(map(str, path)))
    period = 1e9 / CLOCK_HZ
    return CONSTRAINTS.format(
        preset=config.name,
        megahertz=CLOCK_HZ / 1e6,
        period=period,
        uncertainty=period / 10,
        half=period / 2,
        inputs=" ".join(ports[True]),
        outputs=" ".join(ports[False]),
        reset=RESET_CYCLES,
    )
