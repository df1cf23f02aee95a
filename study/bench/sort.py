"""Cycles of stage 2 in RTL simulation, by length of the list and kind of keys."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.table import Column, Table
from splatcore.sim.cycles.sort import stage_cycles
from splatcore.sim.frame.picture import write_figure
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import Config
from splatcore.spec.sort import half_entries
from splatcore.study.bench.sort_parts import KEYS, SortStage, entries_of, stage_rows

LENGTHS = (1, 2, 4, 8, 16, 32, 64, 100, 128, 129, 200, 256, 400, 512, 700, 1024, 1300, 1500,
           2048, 2049, 3000, 4096, 5200, 7000, 10_000, 14_000, 20_000)  # fmt: skip
"""Lengths of lists: common ones, and the hard case of 20,000."""

BOUND, BOUND_FROM, BOUND_TO = 4.5, 16, 2048
"""Maximum cycles per entry, 1.5·(1 for loading + 2·1 for output), and the lengths that it applies
to."""

INCHES = (9.0, 5.5)
DOTS_PER_INCH = 150


def bench_sort(config: Config, lengths: Sequence[int], plot: Path) -> tuple[dict, list[int]]:
    """Measure lists of several lengths; print a table and write a plot.

    Returns the cycles by kind of keys, and the cycle model's.
    """
    simulation, total = Simulation(SortStage(config)), len(KEYS) * len(lengths)
    found = {kind: [] for kind in KEYS}
    with progress_bar("sorting", total) as advance:
        for length in lengths:
            for kind, values in found.items():
                values.append(_measure(simulation, config, kind, length))
                advance(sum(map(len, found.values())), total)
    keys = [entries_of(config, "random", [length])["key"] for length in lengths]
    model = [stage_cycles(config, [some]) for some in keys]
    _table(config, lengths, found, model).print()
    _write_plot(plot, config, lengths, found, model)
    return found, model


def _measure(simulation: Simulation, config: Config, kind: str, length: int) -> int:
    """Cycles from a list's first entry to its end mark. AssertionError if not sorted."""
    counts = np.array([length])
    rows = stage_rows(config, counts, entries_of(config, kind, counts))
    constants = {"stop": 0}
    result = simulation.run(rows.inputs, constants=constants, expected=rows.counts)
    assert result.finished, result.stopped
    for name, wanted in rows.expected.items():
        assert np.array_equal(result.outputs[name], wanted), f"{kind} {length}: {name}"
    return result.cycles


def _bound_to(config: Config) -> int:
    """The longest list that the bound applies to: it fits on chip."""
    return min(BOUND_TO, half_entries(config))


def _table(config: Config, lengths: Sequence[int], found: dict, model: list[int]) -> Table:
    rows = []
    for length, modelled, *values in zip(lengths, model, *found.values(), strict=True):
        within = BOUND_FROM <= length <= _bound_to(config)
        bound = BOUND * length if within else None
        rows.append([length, *values, modelled, max(values) / length, bound])
    columns = [Column(name, digits=0) for name in ("entries", *found, "model")]
    columns += [Column("per entry", digits=2), Column("bound", digits=0, none="")]
    return Table("sort", f"{config.name}: cycles of stage 2 for one list", columns, rows)


def _write_plot(path: Path, config: Config, lengths: Sequence[int], found: dict, model: list[int]):
    """Plot cycles per entry over the length, with the bound dashed."""
    figure = Figure(INCHES, DOTS_PER_INCH, layout="constrained")
    axes, entries = figure.subplots(), np.array(lengths)
    for number, (kind, values) in enumerate(found.items()):
        # The lines coincide, as the cycles do not depend on the keys.
        axes.plot(entries, values / entries, label=kind, linewidth=6 - number, alpha=0.6)
    axes.plot(entries, model / entries, "k:", label="cycle model")
    axes.plot([BOUND_FROM, _bound_to(config)], [BOUND, BOUND], "r--", label=f"bound {BOUND}")
    axes.set_xscale("log")
    axes.set_ylim(0, 3 * BOUND)
    axes.set_xlabel("entries of the list")
    axes.set_ylabel("cycles per entry")
    axes.set_title(f"Stage 2, {config.name}: one list, from its first entry to its end mark")
    axes.grid(alpha=0.3)
    axes.legend()
    write_figure(path, figure)
