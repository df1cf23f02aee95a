"""Whether a copy of hdl/ still does what the twins say: exit status 1 if not, 0 if it does, 2 if it
cannot be built.

    python -m tb.judge CHECK FOLDER
"""

import sys
from collections.abc import Callable
from functools import partialmethod
from itertools import product

import numpy as np

STALL = 0.4
GAUSSIANS = 6000

FAULTS = 3
"""Random runs of each kind of fault."""

CYCLES_MAX = 2_000_000
"""Cycles of a run at most: a fault may make hardware that gives items for ever."""


def frame():
    """A camera within a garden of Gaussians of very different sizes and distances: chunks behind
    and beside it, points on all sides, Gaussians from below a pixel to beyond the screen.
    """
    from splatcore.model.generate.generate import generate
    from splatcore.model.pack.pack import pack
    from splatcore.spec.camera import look_at
    from splatcore.spec.config import DEFAULT
    from splatcore.spec.scene import Scene
    from tb.helpers.point_rows import point_rows

    rng = np.random.default_rng(0)
    scene = generate("garden", GAUSSIANS)
    far = rng.random((len(scene), 1)) < 0.05
    stretched = np.exp(rng.normal(0, 0.3 + 2.5 * far, (len(scene), 3)))
    away = np.where(far, 50.0, 1.0)
    scene = Scene(
        scene.position * away, scene.scale * stretched, scene.quaternion, scene.opacity,
        scene.sh, "mutation",
    )  # fmt: skip
    camera = look_at((0.0, -0.5, 0.0), (0.0, 0.0, 10.0), 160, 90, 120.0)
    return point_rows(DEFAULT, pack(scene, DEFAULT)[0], camera)


def stage(name: str) -> Callable[[], None]:
    """A stage against the twins, with and without stalls."""
    from splatcore.sim.rtl.streams import Simulation
    from tb.helpers.stage_cases import case, settled_outputs

    rows = frame()
    what = case(name, rows)
    simulation = Simulation(what.component)

    def check():
        for stall in (0, STALL):
            result = simulation.run(
                what.inputs, constants=what.constants, expected=what.counts, first=what.first,
                stall=stall,
            )  # fmt: skip
            found = settled_outputs(name, rows.config, result.outputs)
            assert all(np.array_equal(found[port], what.expected[port]) for port in found)

    return check


def arithmetic() -> Callable[[], None]:
    """The floating-point units against their twins and oracles, as their tests have it."""
    from tb.hdl import test_float

    def check():
        test_float.test_every_pair()
        test_float.test_conversions()
        test_float.test_enable_freezes()
        test_float.test_every_triple()

    return check


def prepare() -> Callable[[], None]:
    """A splat's integers, in the largest formats."""
    from splatcore.spec.config import DEFAULT
    from tb.hdl import test_raster

    test_raster.prepare_simulation(DEFAULT)
    return lambda: test_raster.test_prepare(DEFAULT)


def raster() -> Callable[[], None]:
    """Random tiles on images of several sizes, queues full and empty, stop."""
    from splatcore.spec.config import TINY
    from tb.hdl import test_raster

    test_raster.simulation(TINY)

    def check():
        for size, stall in product(test_raster.SIZES, (0, STALL)):
            test_raster.test_random_tiles(size, stall)
        test_raster.test_groups_without_splats()
        test_raster.test_queues_fill_and_run_empty()
        for count in (20, 500):
            test_raster.test_counters(count)
        test_raster.test_stop()

    return check


def binning() -> Callable[[], None]:
    """Frames of several sizes in a row, little memory, an entry a cycle; rows' ends in units."""
    from tb.hdl import test_bin, test_row_end
    from tb.helpers import bin_frames

    bin_frames.simulation("SHORT")
    test_bin.lists_simulation()

    def check():
        test_row_end.test_row_end_equals_twin()
        test_bin.test_hardware_equals_twin("SHORT")
        test_bin.test_an_entry_a_cycle()
        test_bin.test_queues_and_buffers_fill_and_run_empty()

    return check


def sort() -> Callable[[], None]:
    """Lists of all lengths and kinds of keys, many groups, stop, pace."""
    from splatcore.sim.bench.sort_rows import KEYS
    from tb.hdl import test_sort

    test_sort.simulation("TINY")

    def check():
        for kind in KEYS:
            test_sort.test_tiny_equals_twin(kind)
            test_sort.test_cycles_of_a_list("TINY", kind)
        test_sort.test_cycles_of_many_groups("TINY")
        test_sort.test_counters()
        for stall in (0, STALL):
            for counts in ((40, 64, 5, 30), (3, 300, 20, 64, 17)):
                test_sort.test_stop(counts, stall)

    return check


def machine() -> Callable[[], None]:
    """Whole frames on fast and on slow memory, long lists, odd sizes, and faults of all kinds."""
    from splatcore.sim.machine.script import IDEAL, execute
    from splatcore.spec.config import TINY
    from tb.helpers.fault_runs import IDLE_MAX, KINDS, check_outcome, drawn, run_fault
    from tb.helpers.machines import machine
    from tb.machine import test_machine

    execute.__kwdefaults__ |= {"cycles_max": CYCLES_MAX, "idle_max": IDLE_MAX}
    machine(TINY)

    def check():
        for timing in (IDEAL, test_machine.ROUGH):
            test_machine.test_garden(timing)
        test_machine.test_sizes()
        test_machine.test_path()
        test_machine.test_no_scratch_memory()
        for name in ("long_list", "empty"):
            test_machine.test_hard_cases(name)
        for kind in KINDS:
            for seed in range(FAULTS):
                fault = drawn(kind, seed)
                check_outcome(fault, run_fault(fault, seed))

    return check


CHECKS = {
    "arithmetic": arithmetic, "prepare": prepare, "raster": raster, "bin": binning, "sort": sort,
    "machine": machine,
}  # fmt: skip
"""Each builds what is to be checked and returns the check; stages by their names as well."""


def main(check: str, folder: str) -> int:
    sys.path.insert(0, folder)  # its hdl/ comes before ours
    from splatcore.sim.rtl import build as harness
    from splatcore.sim.rtl.streams import Simulation

    Simulation.run = partialmethod(Simulation.run, cycles_max=CYCLES_MAX)
    # So little is run that what takes long is the compiler.
    harness.ARGS = [*harness.ARGS, "-CFLAGS", "-O0"]
    try:
        holds = CHECKS[check]() if check in CHECKS else stage(check)
    except Exception as error:
        print(error, file=sys.stderr)
        return 2
    try:
        holds()
    except AssertionError:
        return 1
    except Exception as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
