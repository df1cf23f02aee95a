"""The commands `soak frames` and `soak faults`: random runs of small machines in RTL."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import typer

from splatcore.app.cli import options
from splatcore.app.cli.options import KEPT_FOLDER, SCHEDULER, option
from splatcore.sim.common.output import console, make_folder, messages, write_json
from splatcore.sim.common.table import Column, Table
from splatcore.spec.error import InputError


@dataclass(frozen=True)
class Runs:
    """The options of random runs. Raises InputError for impossible ones."""

    output: Path = KEPT_FOLDER
    count: int = option(1000, "N", "Number of frames (soak frames) or faults (soak faults).")
    seed: int = option(0, "N", "Random seed.")
    only: list[int] | None = option(
        None, "NUMBER", "Repeat the run of this number only; repeatable."
    )
    scheduler: str | None = SCHEDULER

    def __post_init__(self):
        for name, value, minimum in (("--count", self.count, 1), ("--seed", self.seed, 0)):
            if value < minimum:
                raise InputError(f"{name} {value}: must be ≥ {minimum}")


@options.command("soak frames")
def frames_command(runs: Runs):
    """Render random small scenes in RTL, against the golden model.

    Machines and memories are random, too. Compares the pixels of each frame with the golden
    model's, and the counters that do not depend on time. A run has 8 frames, two in flight. Results
    already in DIR are kept as long as the code is the same. Inputs of a wrong run are saved in
    DIR/wrong/NUMBER. Writes DIR/frames.json; exit status 1 if anything is wrong.
    """
    from splatcore.sim.soak.frame_runs import FRAMES, frame_run, keep

    found = run("frames", frame_run, runs, range(-(-runs.count // FRAMES)))
    for each in found:
        if each["wrong"] and "frames" in each:  # the run came to an end
            keep(runs.output / "wrong" / str(each["number"]), runs.seed, each["number"])
    finish("frames", found, runs, "machine", ("frames", "cycles"))


@options.command("soak faults")
def faults_command(runs: Runs):
    """Inject random faults in RTL: each must be reported, none may hang.

    Faults are memory errors, bad models and registers, ABORT and resets, alone or with another
    frame in flight. The reported error must be right; the other frame and the next one must be
    identical to the golden model's. Results already in DIR are kept as long as the code is the
    same. Writes DIR/faults.json; exit status 1 if anything is wrong.
    """
    from splatcore.sim.soak.fault_kinds import fault_run

    finish("faults", run("faults", fault_run, runs, range(runs.count)), runs, "kind", ())


def run(kind: str, function: Callable[[int, int], dict], runs: Runs, numbers: range) -> list[dict]:
    """Run the numbered runs; return their results by number.

    A wrong run is reported at once, with the command that repeats it. A run that failed is a
    wrong result.
    """
    from splatcore.study.bench.campaign import Failure, Task, results

    seed, output = runs.seed, runs.output
    make_folder(output)
    numbers = runs.only or numbers
    tasks = [Task(f"{seed}-{n}", f"{kind} {seed} {n}", function, (seed, n)) for n in numbers]
    found = []
    for task, result in results(tasks, output / kind, runs.scheduler, f"soak {kind}"):
        number = task.arguments[1]
        if isinstance(result, Failure):
            result = {"machine": "?", "kind": "?", "number": number, "wrong": result.why}
        if result["wrong"]:
            again = f"splatcore soak {kind} --seed {seed} --only {number} -o {output}/again"
            text = f"run {number}: {result['wrong']}\n  {again}"
            messages.print(text, soft_wrap=True)
        found.append(result)
    return sorted(found, key=lambda result: result["number"])


def finish(kind: str, found: list[dict], runs: Runs, by: str, sums: tuple[str, ...]):
    """Print one row per machine or kind and write the result; exit with status 1 if one is wrong.

    by: key of the rows, "machine" or "kind"
    sums: keys to add up
    """
    rows = []
    for name in dict.fromkeys(each[by] for each in found):
        some = [each for each in found if each[by] == name]
        row = {by: name, "runs": len(some), "wrong": sum(bool(each["wrong"]) for each in some)}
        rows.append(row | {key: sum(each.get(key, 0) for each in some) for key in sums})
    numbers = (Column(key, digits=0) for key in ("runs", *sums, "wrong"))
    Table.of("soak", f"seed {runs.seed}", [Column(by), *numbers], rows).print()
    wrong = [each for each in found if each["wrong"]]
    machines = Counter(each["machine"] for each in found)
    path = runs.output / f"{kind}.json"
    write_json(path, {"seed": runs.seed, "runs": len(found), "machines": machines, "wrong": wrong})
    parts = [f"{sum(each.get(key, 0) for each in found):,} {key}" for key in sums]
    parts = [f"{len(found):,} runs", *parts, f"{len(machines)} machines", f"{len(wrong)} wrong"]
    console.print(f"{', '.join(parts)}; {path}")
    if wrong:
        raise typer.Exit(1)
