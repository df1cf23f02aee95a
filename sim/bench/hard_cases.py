"""The hard cases through an engine: picture, error, cycles, what is left out, and the bound."""

from dataclasses import dataclass, field, replace

import numpy as np

from splatcore.golden import pipeline
from splatcore.golden.reference import Frame, render
from splatcore.model.generate.hard import HARD, HardCase
from splatcore.model.generate.hard_case import PSNR_MIN
from splatcore.model.pack.pack import pack
from splatcore.model.pack.report import PackReport
from splatcore.sim.common.metric import LEVELS, Difference, against, difference, psnr
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.machine.diagnosis import diagnose
from splatcore.sim.machine.engines import cycles
from splatcore.sim.machine.machine import Job, Machine, Run
from splatcore.sim.machine.path import simulate
from splatcore.sim.machine.script import Timing
from splatcore.sim.packing.choose import finest
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.raster import faint_rule

BOUNDS = {
    "reference": "finite; left out: NaN and Inf only",
    "golden": f"machine, own rule ≥ {PSNR_MIN:.0f} dB",
    "rtl": f"golden's, machine, own rule ≥ {PSNR_MIN:.0f} dB",
}
"""The bound of a case by engine; machines leave out all NaN and Inf, too. Some cases bound what
packing loses, besides."""


@dataclass(eq=False)
class Outcome:
    """The result of an engine on a hard case; None for what there is not.

    pixels, reference: uint8 [H, W, 3], the engine's picture and the one it is compared with.
    left_out: Gaussians by cause. psnr_db: of `pixels` against the reference before its rounding to
    8 bits, which can make a whole step of a tiny error; reason: why it is None. psnr_db_rule: the
    same against the reference under the machine's rule for what is too faint. scene: `pixels`
    against the reference's picture of the scene as it is. packing: the
    reference's picture of the packed model against the scene's. identical: to the golden model's
    picture. failures: bounds that are not met. Of the packed case: its model, what packing says of
    it, and the reference's frames, `whole` of the scene, `exact` and `ruled`, by that rule, of the
    model.
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
        """The case in the file of `--json`."""
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
    """A case's camera, with another number of pixels if there is a size."""
    return case.camera.resized(*size) if size else case.camera


def measure(
    name: str,
    engine: str,
    config: Config,
    size: tuple[int, int] | None,
    machine: Machine | None,
    timing: Timing,
) -> Outcome:
    """Run a hard case through an engine and judge it; `machine` is there for rtl only."""
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
    """Pack a case for a machine, and render both scene and model by the reference."""
    rule = replace(SPLATCORE, faint=faint_rule(config))
    outcome.model, outcome.report = pack(case.scene, config, quality=finest(case.scene, config))
    with np.errstate(invalid="ignore"):  # an infinite quaternion has no rotation
        outcome.whole = render(case.scene.gaussians(), camera)
    outcome.exact = render(outcome.model.gaussians(), camera)
    outcome.ruled = render(outcome.model.gaussians(), camera, rule)


def check_packing(outcome: Outcome, case: HardCase):
    """The reference's picture of the packed model against that of the scene; no bound for machines
    that render models with codebooks only, which leave out degrees 2 and 3."""
    outcome.packing = difference(outcome.exact.pixels, outcome.whole.pixels)
    least, found = case.packing_db, outcome.packing.psnr_db
    if least is None or outcome.model.format.codebooks:
        return
    outcome.bound += f"; packing ≥ {least:g} dB"
    if found is not None and found < least:
        outcome.failures.append(f"packing: {found:.2f} dB, below {least:g} dB")


def of_reference(outcome: Outcome):
    """The reference's picture of the scene; the map of errors is that of packing."""
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
    """The golden model's picture, its cycles by the cycle model."""
    frame = pipeline.render(config, outcome.model, camera)
    points = frame.points
    leave_out(outcome, len(points.points) - len(points.front), len(frame.binned.kept))
    outcome.cycles = frame_cycles(config, frame).frame
    compare(outcome, frame.pixels)


def of_hardware(outcome: Outcome, job: Job, machine: Machine, timing: Timing):
    """The simulated machine's picture, its cycles as measured; the golden model's beside it."""
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
    """Count what does not reach a tile's list: dropped by packing, by the machine."""
    report = outcome.report
    outcome.left_out = {
        "not_finite": report.not_finite,
        "transparent": report.transparent,
        "near_culled": behind,
        "unseen": report.packed - behind - drawn,
    }


def compare(outcome: Outcome, pixels: np.ndarray):
    """A machine's picture against the reference on the same packed model."""
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
            f"{outcome.psnr_db_rule:.2f} dB against the reference under its rule, below "
            f"{PSNR_MIN:.0f} dB"
        )


def check_left_out(outcome: Outcome, case: HardCase):
    """All Gaussians that hold NaN or Inf must have been left out for that, and no others."""
    if "not_finite" not in outcome.left_out:
        return  # the machine failed before it said anything
    names = ("position", "scale", "quaternion", "opacity", "sh")
    sound = np.ones(outcome.gaussians, bool)
    for name in names:
        values = getattr(case.scene, name)
        sound &= np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    wanted, found = int((~sound).sum()), outcome.left_out["not_finite"]
    if found != wanted:
        outcome.failures.append(
            f"{found} Gaussians left out for NaN or Inf, {wanted} of the scene have one"
        )
