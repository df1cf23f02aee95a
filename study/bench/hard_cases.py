"""Run the hard cases through an engine: picture, error, cycles, dropped Gaussians, bound."""

from dataclasses import dataclass, field, replace

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
from splatcore.sim.frame.metric import LEVELS, Difference, against, difference, psnr
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

BOUNDS = {
    "reference": "finite; drops NaN and Inf only",
    "golden": f"machine, own rule ≥ {PSNR_MIN:.0f} dB",
    "rtl": f"golden's, machine, own rule ≥ {PSNR_MIN:.0f} dB",
}
"""Bound of a case by engine. Every engine must drop exactly the Gaussians with NaN or Inf. Some
cases also bound the loss of packing."""


@dataclass(eq=False)
class Outcome:
    """The result of an engine on a hard case; None: does not apply.

    pixels, reference: uint8 [H, W, 3], the engine's picture and the one it is compared with
    left_out: dropped Gaussians by cause
    psnr_db: `pixels` against the unrounded reference on the packed model; rounding can turn a tiny
        error into a whole step
    reason: why psnr_db is None
    psnr_db_rule: the same against the reference with the machine's faintness rule
    error, scene: `pixels` against the reference's picture of the packed model, of the scene
    packing: the reference's picture of the packed model against its picture of the scene
    identical: whether `pixels` equal the golden model's
    failures: bounds that are not met
    model, report: packed model, and report of its packing
    whole, exact, ruled: the reference's frames of the scene, of the model, and of the model with
        the machine's faintness rule
    """

    name: str
    about: str
    bound: str
    size: tuple[int, int]
    gaussians: int
    pixels: np.ndarray | None = None
    reference: np.ndarray | None = None
    left_out: dict[str, int] = field(default_factory=dict)
    psnr_db: float | None = None
    reason: str | None = None
    psnr_db_rule: float | None = None
    error: Difference | None = None
    scene: Difference | None = None
    packing: Difference | None = None
    identical: bool | None = None
    cycles: int | None = None
    failures: list[str] = field(default_factory=list)
    model: PackedModel | None = None
    report: PackReport | None = None
    whole: Frame | None = None
    exact: Frame | None = None
    ruled: Frame | None = None

    @property
    def passed(self) -> bool:
        return not self.failures

    def facts(self) -> dict:
        """The case as an object for --json."""
        names = (
            "about", "size", "gaussians", "left_out", "reason", "psnr_db_rule", "identical",
            "cycles", "bound", "passed", "failures",
        )  # fmt: skip
        none = Difference(None, None, None)
        found = {"machine": self.error, "scene": self.scene, "packing": self.packing}
        metrics = against({name: one or none for name, one in found.items()})
        finer = {"psnr_db_machine": self.psnr_db}
        return {name: getattr(self, name) for name in names} | metrics | finer


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
    shape = camera.width, camera.height
    outcome = Outcome(name, case.about, BOUNDS[engine], shape, len(case.scene))
    try:
        prepare(outcome, case, camera, config)
    except InputError as error:
        outcome.failures.append(str(error))
        return outcome
    check_packing(outcome, case)
    if engine == "reference":
        of_reference(outcome)
    elif engine == "golden":
        of_golden(outcome, camera, config)
    else:
        of_hardware(outcome, Job(outcome.model, camera), machine, timing)
    check_left_out(outcome, case)
    return outcome


def prepare(outcome: Outcome, case: HardCase, camera: Camera, config: Config):
    """Pack a case for a machine, and render scene and model by the reference."""
    rule = replace(SPLATCORE, faint=faint_rule(config))
    outcome.model, outcome.report = pack(case.scene, config, quality=finest(case.scene, config))
    with np.errstate(invalid="ignore"):  # an infinite quaternion has no rotation
        outcome.whole = render(case.scene.gaussians(), camera)
    outcome.exact = render(outcome.model.gaussians(), camera)
    outcome.ruled = render(outcome.model.gaussians(), camera, rule)


def check_packing(outcome: Outcome, case: HardCase):
    """Compare the reference's pictures of the packed model and of the scene.

    The bound does not apply to models with codebooks, which drop degrees 2 and 3.
    """
    outcome.packing = difference(outcome.exact.pixels, outcome.whole.pixels)
    least, found = case.packing_db, outcome.packing.psnr_db
    if least is None or outcome.model.format.codebooks:
        return
    outcome.bound += f"; packing ≥ {least:g} dB"
    if found is not None and found < least:
        outcome.failures.append(f"packing: {found:.2f} dB, below {least:g} dB")


def of_reference(outcome: Outcome):
    """Use the reference's picture of the scene; its error map is the error of packing."""
    counts = outcome.whole.counts
    outcome.pixels, outcome.reference = outcome.whole.pixels, outcome.exact.pixels
    outcome.reason = "the reference itself"
    outcome.left_out = {name: counts[name] for name in ("not_finite", "near_culled")}
    outcome.left_out["unseen"] = (
        outcome.gaussians - sum(outcome.left_out.values()) - counts["visible"]
    )
    if not np.isfinite(outcome.whole.image).all():
        outcome.failures.append("a pixel is not finite")


def of_golden(outcome: Outcome, camera: Camera, config: Config):
    """Render by the golden model; cycles are the cycle model's."""
    frame = pipeline.render(config, outcome.model, camera)
    points = frame.points
    leave_out(outcome, len(points.points) - len(points.front), len(frame.binned.kept))
    outcome.cycles = frame_cycles(config, frame).frame
    compare(outcome, frame.pixels)


def of_hardware(outcome: Outcome, job: Job, machine: Machine, timing: Timing):
    """Simulate the machine in RTL, and compare with the golden model."""
    run: Run = simulate(machine, [job], timing, f"simulating {outcome.name}")
    if not run.done:
        outcome.identical = False
        outcome.failures.append(f"the machine failed: {run.why}")
        return
    counters = run.frames[0].counters
    behind = counters["points_points"] - counters["points_front"]
    leave_out(outcome, behind, counters["bin_kept"])
    outcome.cycles = cycles(run)["frame"]
    compare(outcome, run.frames[0].pixels)
    found = diagnose(machine.config, run, 0, pipeline.render(machine.config, *job))
    outcome.identical = found is None
    if found:
        outcome.failures.append(str(found))


def leave_out(outcome: Outcome, behind: int, drawn: int):
    """Count the Gaussians that reach no tile list: dropped by packing or by the machine.

    behind: not in front of the near plane
    drawn: in a tile list
    """
    report = outcome.report
    outcome.left_out = {
        "not_finite": report.not_finite,
        "transparent": report.transparent,
        "near_culled": behind,
        "unseen": report.packed - behind - drawn,
    }


def compare(outcome: Outcome, pixels: np.ndarray):
    """Compare a machine's picture with the reference on the packed model and on the scene."""
    outcome.pixels, outcome.reference = pixels, outcome.exact.pixels
    outcome.error = difference(pixels, outcome.exact.pixels)
    outcome.scene = difference(pixels, outcome.whole.pixels)
    outcome.psnr_db, outcome.psnr_db_rule = (
        psnr(pixels / LEVELS, frame.image.clip(0, 1)) for frame in (outcome.exact, outcome.ruled)
    )
    if outcome.psnr_db is None:
        empty = "an empty scene: " if not outcome.gaussians else ""
        outcome.reason = f"{empty}identical pictures"
    if outcome.psnr_db_rule is not None and outcome.psnr_db_rule < PSNR_MIN:
        outcome.failures.append(
            f"{outcome.psnr_db_rule:.2f} dB against the reference with its own rule, below "
            f"{PSNR_MIN:.0f} dB"
        )


def check_left_out(outcome: Outcome, case: HardCase):
    """Check that exactly the Gaussians with NaN or Inf were dropped as not finite."""
    if "not_finite" not in outcome.left_out:
        return  # the machine failed before it reported counts
    names = ("position", "scale", "quaternion", "opacity", "sh")
    sound = np.ones(outcome.gaussians, bool)
    for name in names:
        values = getattr(case.scene, name)
        sound &= np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    wanted, found = int((~sound).sum()), outcome.left_out["not_finite"]
    if found != wanted:
        dropped = f"{found} Gaussian{'' if found == 1 else 's'} dropped"
        outcome.failures.append(f"{dropped} for NaN or Inf, but {wanted} have one")
