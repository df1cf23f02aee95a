"""Whether a copy of hdl/ still does what the twins say: exit status 1 if not, 0 if it does, 2 if it
cannot be built.

    python -m tb.judge CHECK FOLDER
"""

import sys

import numpy as np

CHECKS = ("chunk", "cull", "place", "project", "arithmetic")
STALL = 0.4
GAUSSIANS = 6000


def frame():
    """A camera within a garden of Gaussians of very different sizes and distances: chunks behind
    and beside it, points on all sides, Gaussians from below a pixel to beyond the screen.
    """
    from model.generate import generate
    from model.pack import pack
    from spec.camera import look_at
    from spec.config import DEFAULT
    from spec.scene import Scene
    from tb.point_rows import point_rows

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


def stage_holds(stage: str) -> bool:
    """A stage against the twins, with and without stalls."""
    from sim.streams import Simulation
    from tb.stage_cases import case, settled_outputs

    rows = frame()
    what = case(stage, rows)
    simulation = Simulation(what.component)
    for stall in (0, STALL):
        try:
            result = simulation.run(
                what.inputs, constants=what.constants, expected=what.counts, first=what.first,
                stall=stall,
            )  # fmt: skip
        except AssertionError:
            return False
        found = settled_outputs(stage, rows.config, result.outputs)
        if not all(np.array_equal(found[port], what.expected[port]) for port in found):
            return False
    return True


def arithmetic_holds() -> bool:
    """The floating-point units against their twins and oracles, as their tests have it."""
    from tb import test_float

    try:
        test_float.test_every_pair()
        test_float.test_conversions()
        test_float.test_enable_freezes()
        test_float.test_every_triple()
    except AssertionError:
        return False
    return True


def main(check: str, folder: str) -> int:
    sys.path.insert(0, folder)  # its hdl/ comes before ours
    try:
        if check == "arithmetic":
            return 0 if arithmetic_holds() else 1
        return 0 if stage_holds(check) else 1
    except Exception as error:
        print(error, file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
