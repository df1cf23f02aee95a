"""The C++ program around the Verilated machine: memory, a host that runs a script, a watchdog.

A run's files are in one folder: `settings` (one name and its values per line), `script` (one
command per line, see `sim.machine.script`) and `memory`, the bytes that the machine's AXI4 master
accesses. The program writes `report` and prints its progress.
"""

import re
from pathlib import Path

from splatcore.sim.rtl.build import FAST, build
from splatcore.sim.rtl.merge import merged
from splatcore.spec.axi import BOUNDARY, ID_BITS, port_bytes
from splatcore.spec.config import Config
from splatcore.spec.registers import INTERRUPT_ERROR, INTERRUPT_FRAME

FOLDER = Path(__file__).parent
TOGGLES = (FOLDER / "toggles.hpp").read_text()  # counts changes of nets

CONFIG = f"""\
#pragma once

#include <cstdint>

#define WAVES {{waves}}
#define FST {{fst}}
#define TOGGLES {{toggles}}
#define SAVES {{saves}}

constexpr uint64_t BEAT = {{beat}}, BOUNDARY = {BOUNDARY};
constexpr uint32_t BEAT_BITS = {{beat_bits}}, INTERRUPT_ERROR = {INTERRUPT_ERROR};
constexpr uint32_t INTERRUPT_FRAME = {INTERRUPT_FRAME};
constexpr uint32_t ID_BITS = {ID_BITS};
"""


OUTLINED = "--inline-mult", "2000"
"""Verilator's arguments for large modules that are not copied into each place of their use: DEFAULT
runs 1.07 times as fast, as all rasterizers execute the same code."""


INPUT = re.compile(r"^  input (\[\S+\] )?(m_axi__\w+|rst);\n", re.M)


def with_held_inputs(source: str) -> str:
    """Verilog whose module `top` has registers for the inputs from memory, and for the reset: logic
    behind inputs is evaluated at both edges of the clock, logic behind registers once a cycle.

    The program drives them before the rising edge, so they reach the machine when they did without
    registers, except the reset, which begins and ends a cycle later.
    """
    top = re.search(r"^(module top ?\(.*?;\n)(.*?^endmodule$)", source, re.M | re.S)
    header, body = top.groups()
    held = INPUT.findall(body)
    names = "|".join(name for _, name in held)
    inside = re.sub(rf"^  (input|wire) (\[\S+\] )?({names});\n", "", body, flags=re.M)
    inside = re.sub(rf"(?<![\w.$\\])({names})(?![\w$])", r"held_\1", inside)
    registers = [
        f"  input {width}{name};\n  reg {width}held_{name};\n"
        f"  initial held_{name} = {int(name == 'rst')};\n"
        f"  always @(posedge clk) held_{name} <= {name};\n"
        for width, name in held
    ]
    return source.replace(header + body, header + "".join(registers) + inside)


def compiled(
    config: Config,
    source: str,
    trace: str = "",
    toggles: bool = False,
    saves: bool = False,
    level: str = FAST,
) -> Path:
    """Compile the program for a machine's Verilog; its path.

    trace: kind of waveforms that it can write, "vcd" or "fst"; empty for none
    toggles: whether it counts changes of each net (SAIF)
    saves: whether it can save its state and go on from there
    level: optimisation level of the C++ compiler
    """
    more = (f"--trace-{trace}", "--no-trace-params") if trace else ()
    if toggles:
        more = ("--trace-saif", "--trace-max-width", "0", "--no-trace-params")
    more += OUTLINED + ("--savable",) * saves
    beat, waves = port_bytes(config), int(bool(trace) and not toggles)
    settings = CONFIG.format(
        waves=waves, fst=int(trace == "fst"), toggles=int(toggles), saves=int(saves),
        beat=beat, beat_bits=beat.bit_length() - 1,
    )  # fmt: skip
    main, made = FOLDER / "program.cpp", {"config.hpp": settings}
    return build(with_held_inputs(merged(source)), main, made, FOLDER.glob("*.hpp"), more, level)
