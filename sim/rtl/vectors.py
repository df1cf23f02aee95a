"""Runs a component on arrays of inputs, one element a cycle, compiled by Verilator.

For arithmetic and other parts without a protocol: millions of cycles in seconds, no Python inside.
"""

import hashlib
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from amaranth.back import verilog
from amaranth.hdl import Shape
from amaranth.lib import wiring

from splatcore.sim.rtl.verilator import environment

BUILD = Path("build") / "vectors"
"""Where compiled simulations are kept, by the hash of what they were made from."""

PORT_BITS = 64
"""Widest port that an array can drive."""

MAIN = """\
#include "Vtop.h"
#include <cstdint>
#include <cstdio>
#include <vector>

// {n_in} input and {n_out} output ports: a row of 64-bit words for each cycle.
int main(int argc, char** argv) {{
    FILE* in = std::fopen(argv[1], "rb");
    FILE* out = std::fopen(argv[2], "wb");
    std::vector<uint64_t> i({n_in}), o({n_out});
    Vtop top;
    top.clk = 0;
    top.rst = 1;
    for (int k = 0; k < 2; k++) {{ top.clk = 1; top.eval(); top.clk = 0; top.eval(); }}
    top.rst = 0;
    while (std::fread(i.data(), 8, {n_in}, in) == {n_in}) {{
        {drive}
        top.eval();
        {sample}
        std::fwrite(o.data(), 8, {n_out}, out);
        top.clk = 1; top.eval();
        top.clk = 0; top.eval();
    }}
    top.final();
    return std::fclose(out);
}}
"""


def run(component: wiring.Component, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Outputs [N] of a component for inputs [N], all as unsigned codes.

    In cycle n the inputs' elements n are applied, then outputs are sampled, then the clock rises:
    a component of latency L answers input n in sample n + L. Ports are plain signals or one-vector
    payloads of at most 64 bits; all inputs must be given (a number stands for a constant array).
    """
    given, read = ports(component)
    if set(given) != set(inputs):
        raise ValueError(f"inputs {sorted(inputs)} are not {sorted(given)}")
    count = max(np.size(array) for array in inputs.values())
    rows = np.stack([np.broadcast_to(inputs[name], count) for name in given], axis=1)
    folder = build(component, given, read)
    with TemporaryDirectory() as scratch:
        given_file, found_file = Path(scratch) / "in", Path(scratch) / "out"
        given_file.write_bytes(np.ascontiguousarray(rows, "<u8").tobytes())
        subprocess.run([folder / "obj" / "Vtop", given_file, found_file], check=True)
        samples = np.fromfile(found_file, "<u8").reshape(count, len(read))
    return {name: samples[:, k] for k, name in enumerate(read)}


def ports(component: wiring.Component) -> tuple[list[str], list[str]]:
    """Verilog names of a component's input and output ports."""
    names = {wiring.In: [], wiring.Out: []}
    for path, member, _ in component.signature.flatten(component):
        width = Shape.cast(member.shape).width
        if width > PORT_BITS:
            raise ValueError(f"port {path} has {width} bits, more than {PORT_BITS}")
        names[member.flow].append("__".join(map(str, path)))
    return names[wiring.In], names[wiring.Out]


def build(component: wiring.Component, given: list[str], read: list[str]) -> Path:
    """Folder of the compiled simulation, made unless it is there already."""
    source = verilog.convert(component, name="top", emit_src=False)
    main = MAIN.format(
        n_in=len(given),
        n_out=len(read),
        drive=" ".join(f"top.{name} = i[{k}];" for k, name in enumerate(given)),
        sample=" ".join(f"o[{k}] = top.{name};" for k, name in enumerate(read)),
    )
    clocked = "input clk" in source
    if not clocked:  # a combinational component: there is no clock to drive
        main = "\n".join(line for line in main.splitlines() if "rst" not in line)
        main = main.replace("top.clk = 0;", "").replace("top.clk = 1; top.eval();", "")
    digest = hashlib.sha256((source + main).encode()).hexdigest()[:16]
    folder = (BUILD / digest).absolute()
    if not (folder / "obj" / "Vtop").exists():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "top.v").write_text(source)
        (folder / "main.cpp").write_text(main)
        subprocess.run(
            ["verilator", "--cc", "--exe", "--build", "-O3", "-Wno-fatal", "--top-module", "top",
             "-Mdir", "obj", "top.v", "main.cpp"],
            cwd=folder, env=environment(), check=True, capture_output=True,
        )  # fmt: skip
    return folder
