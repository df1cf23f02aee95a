"""Run a cocotb testbench, a module of `tb`, on a component in Verilator or Icarus."""

import json
import os
import re
import shutil
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch
from xml.etree import ElementTree

import cocotb
import cocotb_tools.config
from amaranth.lib import wiring
from cocotb_tools.runner import get_runner

from splatcore.sim.rtl.build import QUICK, SPLIT, shared
from splatcore.sim.rtl.convert import converted
from splatcore.sim.rtl.verilator import STATE, environment, state_of, without_initial
from splatcore.spec.cache import kept_folder

PARAMETERS = "SPLATCORE_TESTBENCH"
"""Environment variable that passes a testbench's parameters to the simulation, as JSON."""

PROGRAM = {"verilator": "verilator", "icarus": "iverilog"}  # the compiler of each simulator

ARGS = {
    # Printing the many width warnings takes a tenth of the time; public signals most of the speed.
    "verilator": [
        "-O3",
        "-Wno-lint",
        "-Wno-fatal",
        "--assert",
        "--no-public-flat-rw",
        *STATE,
        *SPLIT,
    ],
    "icarus": [],
}

LOG_LINES = 40  # lines of the simulation's log that a failure shows

COMPLAINT = re.compile("WARNING|ERROR|%Error|error:")
"""Error messages of cocotb, Verilator, Icarus and g++; not Verilator's lint warnings."""

ASSERTION = re.compile(r"^(?:wrong|ERROR): .+$", re.M)
"""A failed assertion of `hdl.lib.holds`, its message and Icarus's line: Icarus goes on after it and
ends with status 0. cocotb's lines begin with a time."""


def run_testbench(
    component: wiring.Component,
    module: str,
    *,
    simulator: str | None = None,
    seed: int = 0,
    **parameters,
) -> None:
    """Run all cocotb tests of `module` on `component`, whose Verilog module is `top`.

    simulator: "verilator" or "icarus"; default: the environment variable SIM, else Verilator
    seed: of Python's `random` in each test and, in Verilator, of the initial values of registers
        and memories; Icarus uses the values in the Verilog
    parameters: JSON values that `parameters()` returns in the testbench
    Raises AssertionError with the names of failed tests and messages of failed assertions.

    The build folder is cached by the Verilog. With WAVES=1 in the environment it also gets the
    waveforms.
    """
    simulator = simulator or os.environ.get("SIM", "verilator")
    if simulator not in PROGRAM:
        raise ValueError(f"simulator {simulator!r} is not one of {', '.join(PROGRAM)}")
    sources = {"top.v": converted(component)}
    if simulator == "verilator":
        flat = component.signature.flatten(component)
        names = ["clk", "rst", *("__".join(map(str, path)) for path, _, _ in flat)]
        sources = {"top.v": without_initial(sources["top.v"]), "top.vlt": public(names)}
    run_sources(sources, module, simulator, seed, **parameters)


def run_sources(
    sources: dict[str, str], module: str, simulator: str = "verilator", seed: int = 0,
    log: Path | None = None, **parameters,
) -> None:  # fmt: skip
    """Run all cocotb tests of `module` on Verilog whose top module is `top`.

    sources: texts by file name; for Verilator with a control file from `public`
    log: file for the simulation's output
    The other parameters are those of `run_testbench`.
    """
    variables = environment() if simulator == "verilator" else dict(os.environ)
    # The runner reads the process's environment.
    with patch.dict(os.environ, variables | {PARAMETERS: json.dumps(parameters)}):
        folder = build(sources, simulator)
        with TemporaryDirectory() as name:
            results = Path(name)
            _run(simulator, module, seed, folder, results, log or results / "log")


def parameters() -> dict:
    """The running testbench's parameters; to be called inside the simulation."""
    return json.loads(os.environ[PARAMETERS])


def build(sources: dict[str, str], simulator: str) -> Path:
    """Compile a simulation unless it is cached; its folder."""
    compiler = shutil.which(PROGRAM[simulator])
    if compiler is None:
        raise RuntimeError(f"no {PROGRAM[simulator]} on PATH")
    waves = os.environ.get("WAVES", "0")
    # cocotb's libraries are linked by their path, so a build belongs to one installation.
    made_from = [sources, ARGS[simulator], compiler, waves, cocotb.__version__]
    made_from.append(cocotb_tools.config.libs_dir)
    return kept_folder("cocotb", made_from, partial(_compile, simulator, sources))


def failures(results: Path) -> list[str]:
    """Name and message of each failed test in cocotb's results; having run none is a failure."""
    tests = list(ElementTree.parse(results).getroot().iter("testcase"))
    if not tests:
        return ["no tests found"]
    failed = []
    for test in tests:
        for kind in ("failure", "error"):
            for node in test.iter(kind):
                message = node.get("error_msg") or node.get("message") or ""
                failed.append(f"{test.get('classname')}.{test.get('name')}: {message}".rstrip(": "))
    return failed


def public(names: list[str]) -> str:
    """A Verilator control file that makes these ports of `top` public."""
    lines = [f'public_flat_rw -module "top" -var "{name}"\n' for name in names]
    return "`verilator_config\n" + "".join(lines)


def _compile(simulator: str, sources: dict[str, str], folder: Path) -> None:
    """Write the sources and have cocotb's runner compile them; AssertionError with the log."""
    for name, text in sources.items():
        (folder / name).write_text(text)
    log, args = folder / "build.log", ARGS[simulator]
    before = dict(os.environ)
    own = shared(folder, before, ["cocotb", *args], QUICK)
    try:
        with (
            own if simulator == "verilator" else nullcontext(before) as variables,
            patch.dict(os.environ, variables),
        ):
            get_runner(simulator).build(
                sources=[folder / name for name in sorted(sources, reverse=True)],
                hdl_toplevel="top",
                build_dir=folder,
                build_args=args,
                timescale=("1ns", "1ps"),
                log_file=log,
            )
    except RuntimeError as error:
        raise AssertionError(f"{simulator} failed: {log}\n{_excerpt(log)}") from error


def _run(simulator: str, module: str, seed: int, folder: Path, results: Path, log: Path) -> None:
    """Run a testbench on a compiled simulation; AssertionError with failed tests and log."""
    xml = results / "results.xml"
    try:
        get_runner(simulator).test(
            test_module=module,
            hdl_toplevel="top",
            hdl_toplevel_lang="verilog",
            build_dir=folder,
            test_dir=folder,
            seed=seed,
            plusargs=state_of(seed) if simulator == "verilator" else [],
            results_xml=str(xml),
            log_file=log,
            waves=os.environ.get("WAVES", "0") != "0",
        )
    except (RuntimeError, SystemExit) as error:  # the runner's reports of failed tests
        if not xml.exists():
            raise AssertionError(f"{simulator} ended without results\n{_excerpt(log)}") from error
    printed = log.read_text(errors="replace")
    failed = failures(xml) + list(dict.fromkeys(ASSERTION.findall(printed)))
    if failed:
        listed = "\n".join(f"  {line}" for line in failed[:LOG_LINES])
        raise AssertionError(f"{simulator}, seed {seed}: failed\n{listed}\n{_excerpt(log)}")


def _excerpt(log: Path) -> str:
    """The lines of a log from the first error message on; without one, the last lines."""
    lines = log.read_text(errors="replace").splitlines() if log.exists() else []
    first = next((k for k, line in enumerate(lines) if COMPLAINT.search(line)), -LOG_LINES)
    return "\n".join(line.strip() for line in lines[first:][:LOG_LINES])
