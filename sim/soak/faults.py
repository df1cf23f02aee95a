"""Random faults on several machines; each outcome is checked by `fault_kinds`."""

from splatcore.sim.soak.fault_kinds import KINDS, PAIR_KINDS, check_outcome, drawn
from splatcore.sim.soak.fault_runs import run_fault
from splatcore.sim.soak.machines import MACHINES

CHOSEN = ("tiny", "default", "4 rasterizers", "group 4", "2 sub-sorters")

WAYS = [(kind, False) for kind in KINDS] + [(kind, True) for kind in PAIR_KINDS]
"""(kind of fault, whether another frame is in flight)."""


def fault_run(seed: int, number: int) -> dict:
    """Simulate run `number`; return its machine, kind and, in "wrong", the failed check as text."""
    (kind, pair), turn = WAYS[number % len(WAYS)], number // len(WAYS)
    name = CHOSEN[turn % len(CHOSEN)]
    config, own = MACHINES[name], (seed << 20) + turn
    wrong = ""
    try:
        fault = drawn(config, kind, own, pair)
        check_outcome(config, fault, run_fault(config, fault, own, pair), pair)
    except AssertionError as error:
        wrong = str(error) or "an assertion failed"
    flight = "with a frame in flight" if pair else "alone"
    return {"machine": name, "number": number, "kind": f"{kind}, {flight}", "wrong": wrong}
