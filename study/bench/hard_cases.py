"""Run the hard cases through an engine: picture, error, cycles, dropped Gaussians, bound."""

from dataclasses import dataclass, replace

import numpy as np

from splatcore.golden import pipeline
from splatcore.golden.reference import Frame, render
from splatcore.model.generate.hard import HARD, HardCase
from splatcore.model.generate.hard_case import PSNR_MIN
from splatcore.model.pack.pack import pack
from splatcore.model.pack.report import PackReport
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.choose import finest
from splatcore.sim.frame.engines import cycles
from splatcore.sim.frame.metric import (
    LEVELS,
    Difference,
    against,
    difference,
    differences,
    psnr,
)
from splatcore.sim.machine.diagnosis import diagnose
from splatcore.sim.machine.machine import Job, Machine, Run
from splatcore.sim.machine.path import simulate
from splatcore.sim.machine.script import Timing
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.raster import faint_rule
from splatcore.study.results import frames
from splatcore.study.results.fields import facts

BOUNDS = {
    "reference": "finite; drops NaN and Inf only",
    "golden": f"machine, own rule ≥ {PSNR_MIN:.0f} dB",
    "rtl": f"golden's, machine, own rule ≥ {PSNR_MIN:.0f} dB",
}
"""Bound of a case by engine. Every engine must drop exactly the Gaussians with NaN or Inf. Some
cases also bound the loss of packing."""


@dataclass(eq=False)
class Outcome:
    """The result of an engine on a hard case.

    row: fields of `study.results.frames.HardCase`; None: does not apply
    pixels, reference: uint8 [H, W, 3], the engine's picture and the one it is compared with
    model, report: packed model, and report of its packing
    whole, exact, ruled: the reference's frames of the scene, of the model, and of the model with
        the machine's faintness rule
    """

    name: str
    case: HardCase
    row: dict
    pixels: np.ndarray | None = None
    reference: np.ndarray | None = None
    model: PackedModel | None = None
    report: PackReport | None = None
    whole: Frame | None = None
    exact: Frame | None = None
    ruled: Frame | None = None

    @classmethod
    def of(cls, name: str, case: HardCase, camera: Camera, engine: str) -> "Outcome":
        """A case before it has run."""
        found = dict.fromkeys(("reason", "psnr_db_rule", "identical", "cycles"))
        found |= against(dict.fromkeys(("machine", "scene", "packing"), Difference(*3 * [None])))
        found |= {"about": case.about, "gaussians": len(case.scene), "bound": BOUNDS[engine]}
        size = [camera.width, camera.height]
        return cls(name, case, found | {"size": size, "left_out": {}, "failures": []})

    @property
    def passed(self) -> bool:
        return not self.row["failures"]

    def facts(self) -> dict:
        """The case as an object for --json."""
        return facts(frames.HardCase(**self.row, passed=self.passed))

    def fail(self, why: str):
        """Add a bound that is not met."""
        self.row["failures"].append(why)


def camera_of(case: HardCase, size: tuple[int, int] | None) -> Camera:
    """A case's camera, resized if a size is given."""
    return case.camera.resized(*size) if size else case.camera


def measure(
    name: str,
    engine: str,
    config: Config,
    size: tuple[int, int] | None,
    machine: Machine | None,
    timing: Timing,
) -> Outcome:
    """Run a hard case through an engine and judge it. machine: for engine rtl only."""
    case = HARD[name]()
    camera = camera_of(case, size)
    outcome = Outcome.of(name, case, camera, engine)
    try:
        prepare(outcome, camera, config)
    except InputError as error:
        outcome.fail(str(error))
        return outcome
    check_packing(outcome)
    if engine == "reference":
        of_reference(outcome)
    elif engine == "golden":
        of_golden(outcome, camera, config)
    else:
        of_hardware(outcome, Job(outcome.model, camera), machine, timing)
    check_left_out(outcome)
    return outcome


def prepare(outcome: Outcome, camera: Camera, config: Config):
    """Pack a case for a machine, and render scene and model by the reference."""
    scene, rule = outcome.case.scene, replace(SPLATCORE, faint=faint_rule(config))
    outcome.model, outcome.report = pack(scene, config, quality=finest(scene, config))
    with np.errstate(invalid="ignore"):  # an infinite quaternion has no rotation
        outcome.whole = render(scene.gaussians(), camera)
    outcome.exact = render(outcome.model.gaussians(), camera)
    outcome.ruled = render(outcome.model.gaussians(), camera, rule)


def check_packing(outcome: Outcome):
    """Compare the reference's pictures of the packed model and of the scene.

    The bound does not apply to models with codebooks, which drop degrees 2 and 3.
    """
    packing = difference(outcome.exact.pixels, outcome.whole.pixels)
    outcome.row |= against({"packing": packing})
    least, found = outcome.case.packing_db, packing.psnr_db
    if least is None or outcome.model.format.codebooks:
        return
    outcome.row["bound"] += f"; packing ≥ {least:g} dB"
    if found is not None and found < least:
        outcome.fail(f"packing: {found:.2f} dB, below {least:g} dB")


def of_reference(outcome: Outcome):
    """Use the reference's picture of the scene; its error map is the error of packing."""
    counts = outcome.whole.counts
    outcome.pixels, outcome.reference = outcome.whole.pixels, outcome.exact.pixels
    left = {name: counts[name] for name in ("not_finite", "near_culled")}
    left["unseen"] = len(outcome.case.scene) - sum(left.values()) - counts["visible"]
    outcome.row |= {"reason": "the reference itself", "left_out": left}
    if not np.isfinite(outcome.whole.image).all():
        outcome.fail("a pixel is not finite")


def of_golden(outcome: Outcome, camera: Camera, config: Config):
    """Render by the golden model; cycles are the cycle model's."""
    frame = pipeline.render(config, outcome.model, camera)
    points = frame.points
    leave_out(outcome, len(points.points) - len(points.front), len(frame.binned.kept))
    outcome.row["cycles"] = frame_cycles(config, frame).frame
    compare(outcome, frame.pixels)


def of_hardware(outcome: Outcome, job: Job, machine: Machine, timing: Timing):
    """Simulate the machine in RTL, and compare with the golden model."""
    run: Run = simulate(machine, [job], timing, f"simulating {outcome.name}")
    if not run.done:
        outcome.row["identical"] = False
        outcome.fail(f"the machine failed: {run.why}")
        return
    counters = run.frames[0].counters
    behind = counters["points_points"] - counters["points_front"]
    leave_out(outcome, behind, counters["bin_kept"])
    compare(outcome, run.frames[0].pixels)
    found = diagnose(machine.config, run, 0, pipeline.render(machine.config, *job))
    outcome.row |= {"cycles": cycles(run)["frame"], "identical": found is None}
    if found:
        outcome.fail(str(found))


def leave_out(outcome: Outcome, behind: int, drawn: int):
    """Count the Gaussians that reach no tile list: dropped by packing or by the machine.

    behind: not in front of the near plane
    drawn: in a tile list
    """
    report = outcome.report
    outcome.row["left_out"] = {
        "not_finite": report.not_finite,
        "transparent": report.transparent,
        "near_culled": behind,
        "unseen": report.packed - behind - drawn,
    }


def compare(outcome: Outcome, pixels: np.ndarray):
    """Compare a machine's picture with the reference on the packed model and on the scene.

    Its PSNR is against the unrounded reference: rounding can turn a tiny error into a whole step.
    """
    outcome.pixels, outcome.reference = pixels, outcome.exact.pixels
    truths = {"machine": outcome.exact.pixels, "scene": outcome.whole.pixels}
    exact, ruled = (
        psnr(pixels / LEVELS, frame.image.clip(0, 1)) for frame in (outcome.exact, outcome.ruled)
    )
    outcome.row |= against(differences(pixels, truths))
    outcome.row |= {"psnr_db_machine": exact, "psnr_db_rule": ruled}
    if exact is None:
        empty = "" if len(outcome.case.scene) else "an empty scene: "
        outcome.row["reason"] = f"{empty}identical pictures"
    if ruled is not None and ruled < PSNR_MIN:
        outcome.fail(
            f"{ruled:.2f} dB against the reference with its own rule, below {PSNR_MIN:.0f} dB"
        )


def check_left_out(outcome: Outcome):
    """Check that exactly the Gaussians with NaN or Inf were dropped as not finite."""
    scene, left_out = outcome.case.scene, outcome.row["left_out"]
    if "not_finite" not in left_out:
        return  # the machine failed before it reported counts
    names = ("position", "scale", "quaternion", "opacity", "sh")
    sound = np.ones(len(scene), bool)
    for name in names:
        values = getattr(scene, name)
        sound &= np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    wanted, found = int((~sound).sum()), left_out["not_finite"]
    if found != wanted:
        dropped = f"{found} Gaussian{'' if found == 1 else 's'} dropped"
        outcome.fail(f"{dropped} for NaN or Inf, but {wanted} have one")
