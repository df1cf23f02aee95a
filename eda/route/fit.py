"""Fit of the wire model of `eda.cells.wires` to routed layouts."""

from collections.abc import Iterable

import numpy as np

CLASSES = ((1, 1), (2, 2), (3, 3), (4, 4), (5, 7), (8, 16), (17, None))
"""Classes of fan-out, first and last; None for no limit."""


def by_fanout(fanout: np.ndarray, length: np.ndarray, capacitance: np.ndarray) -> list[dict]:
    """Nets by class of fan-out.

    fanout, length, capacitance: [nets] sinks, µm and pF of each net
    Returns for each class with nets: its name, nets, mean µm, mean fF, fF per sink.
    """
    found = []
    for first, last in CLASSES:
        here = (fanout >= first) & (fanout <= (last or fanout.max(initial=0)))
        if not here.any():
            continue
        name = str(first) if first == last else f"{first} to {last}" if last else f"{first} or more"
        found.append({
            "fanout": name, "nets": int(here.sum()), "um": float(length[here].mean()),
            "ff": 1000 * float(capacitance[here].mean()),
            "ff_per_sink": 1000 * float(capacitance[here].sum() / fanout[here].sum()),
        })  # fmt: skip
    return found


def fitted(
    fanouts: Iterable[np.ndarray], capacitances: Iterable[np.ndarray], inverter: float
) -> tuple[float, float]:
    """Least-squares fit of the nets of several layouts, each layout with the same weight.

    fanouts, capacitances: [nets] of each layout, capacitances in pF
    inverter: pF of the smallest inverter's input
    Returns inverter inputs per net and per load.
    """
    rows, values = [], []
    for fanout, capacitance in zip(fanouts, capacitances, strict=True):
        weight = len(fanout) ** -0.5
        rows.append(weight * np.stack([np.ones(len(fanout)), fanout], axis=1))
        values.append(weight * capacitance / inverter)
    per_net, per_load = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values))[0]
    return float(per_net), float(per_load)
