"""A row's end against its golden model, to the unit; tests of tiles would miss such errors."""

import numpy as np
import pytest

from splatcore.golden.footprint import OUTLINE, right_end
from splatcore.hdl.binning.row_end import END_BITS, LATENCY, SLOPE_AT, WIDTH_AT, RowEnd
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.binning import FACTOR_FRACTION, HALF_BITS, lean_margin, outward
from splatcore.spec.config import TINY

SHEAR_AT = 2  # cycles from a band to its shear


def bands(count: int) -> dict[str, np.ndarray]:
    """Return bands [N] of outlines of all sizes; lean is inside, beyond, or near the margin."""
    rng = np.random.default_rng(0)
    half = rng.integers(2, 1 << rng.integers(2, HALF_BITS + 1, count))
    low, high = np.sort(rng.integers(-half, half + 1, (2, count)), axis=0)
    edge = np.where(rng.random(count) < 0.5, low, high)
    about = edge + rng.integers(-2, 3, count) * lean_margin(TINY) + rng.integers(-1, 2, count)
    anywhere = rng.integers(-half, half + 1)
    most = 2 << FACTOR_FRACTION
    return {
        "low": low,
        "high": high,
        "box": (rng.random(count) < 0.05).astype(np.int64),
        "lean": np.where(rng.random(count) < 0.5, np.clip(about, -half, half), anywhere),
        "half": half,
        "normalise": HALF_BITS - np.frexp(half.astype(np.float64))[1].astype(np.int64),
        "shear": rng.integers(1 - most, most, count),
        "slope": rng.integers(1, most + 1, count),
        "half_width": rng.integers(1, 1 << HALF_BITS, count),
    }


@pytest.mark.slow
def test_row_end_equals_golden():
    count, margin, out = 20_000, lean_margin(TINY), outward(TINY)
    given, row_end = bands(count), RowEnd(TINY)
    edges = (given["low"] - margin == given["lean"], given["high"] + margin == given["lean"])
    assert all((edge & (given["box"] == 0)).sum() > 100 for edge in edges)
    late = {"shear": SHEAR_AT, "slope": SLOPE_AT, "half_width": WIDTH_AT}
    constants = {}
    for name, values in given.items():
        width = len(getattr(row_end, name))
        codes = np.zeros(count + LATENCY, np.uint64)
        start = late.get(name, 0)
        codes[start : start + count] = values & ((1 << width) - 1)
        constants[name] = codes
    simulation = Simulation(row_end, ["o"])
    found = simulation.run({}, constants=constants).samples["o"].astype(np.int64)
    found = found[LATENCY : LATENCY + count]
    found -= (found >> END_BITS - 1) << END_BITS
    outlines = np.zeros(count, OUTLINE)
    outlines["x"]["half"], outlines["y"]["half"] = given["half_width"], given["half"]
    for name in ("shear", "slope", "lean", "normalise"):
        outlines[name] = given[name]
    expected = [
        right_end(outline, low, high, 1, margin, out)
        for outline, low, high in zip(outlines, given["low"], given["high"], strict=True)
    ]
    assert (found == np.where(given["box"], given["half_width"], expected)).all()
