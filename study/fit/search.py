"""Search of the smallest machine that reaches a frame rate and a PSNR on some views.

Speed and error are nearly independent: sizes change no picture, and formats hardly change the
work. So sizes are chosen first, with DEFAULT's formats; then formats, by the gates that they save
at these sizes; then sizes again, for the frames that these formats produce.
"""

from collections.abc import Callable
from dataclasses import dataclass

from splatcore.golden.pipeline import Frame
from splatcore.sim.cycles.frame import Cycles
from splatcore.spec.config import DEFAULT, FORMATS, Config
from splatcore.study.fit.formats import SEARCHED, Search, decibels, wider
from splatcore.study.fit.gates import SHARES, bits_of
from splatcore.study.fit.sizes import SIZES, Missed, Speed, budget, smaller
from splatcore.study.fit.views import View

Progress = Callable[[str], None]  # called with the name of the step that begins

OF_WORK = tuple(field for field, format in FORMATS.items() if format.in_work)
"""Formats that change when pixels terminate, and so the work."""


class Impossible(Exception):
    """No machine reaches the target; the message has the reason and the best result."""


@dataclass(eq=False)
class Fit:
    """A machine, and how it was chosen.

    most: maximum cycles per frame
    errors: by view, mean squared and largest error of its picture
    psnr: dB asked for
    search: of formats; None without a PSNR to reach
    """

    config: Config
    speed: Speed
    most: int
    errors: dict[str, tuple[float, float]]
    psnr: float | None
    search: Search | None = None

    def cycles(self, view: str) -> Cycles:
        """Cycles of a view's frame."""
        return self.speed.cycles(self.config, view)

    def fps(self, view: str) -> float:
        """Frames per second by the cycle model, with margins."""
        return fps_of(self.cycles(view).frame)


def fps_of(cycles: int) -> float:
    """Frames per second at `cycles` per frame of the cycle model: the inverse of `budget`."""
    return budget(1.0) / cycles


def fit(
    start: Config, views: list[View], fps: float, psnr: float | None, progress: Progress
) -> Fit:
    """Find the smallest machine for some views.

    start: machine with the formats to begin with
    fps: frames per second that every view must reach
    psnr: dB that every view must reach against the same packed model; None: keep the formats
    Raises Impossible if there is no such machine.
    """
    most = budget(fps)
    frames, errors = rendered(start, views, progress)
    if psnr is not None and worst(errors)[1] < psnr:
        start = wider(start)
        frames, errors = rendered(start, views, progress)
        name, found = worst(errors)
        if found < psnr:
            raise Impossible(
                f"--psnr {psnr:g}: {name} has {found:.2f} dB with the widest formats tried"
            )
    speed, sized = sized_for(start, frames, most, fps, progress)
    if psnr is None:
        return Fit(sized, speed, most, errors, psnr)
    hardest = sorted(views, key=lambda view: -errors[view.name][0])[:SEARCHED]
    search = Search(start, hardest, psnr, sized, progress)
    for fixed in ((), OF_WORK):
        search, formats = narrowed(search.without(fixed), views)
        frames, errors = rendered(formats, views, progress)
        speed, found = sized_for(formats, frames, most, fps, progress)
        if found.rasterizers <= sized.rasterizers:
            break
    return Fit(found, speed, most, errors, psnr, search)


def rendered(
    config: Config, views: list[View], progress: Progress
) -> tuple[dict[str, Frame], dict[str, tuple[float, float]]]:
    """Render all views; return frames and errors of their pictures, by view."""
    frames, errors = {}, {}
    for view in views:
        progress(f"rendering {view.name}")
        frames[view.name] = frame = view.frame(config)
        errors[view.name] = view.square(frame.pixels), view.largest(frame.pixels)
    return frames, errors


def worst(errors: dict[str, tuple[float, float]]) -> tuple[str, float]:
    """The view with the largest error, and its PSNR."""
    name = max(errors, key=lambda name: errors[name][0])
    return name, decibels(errors[name][0])


def sized_for(
    config: Config, frames: dict[str, Frame], most: int, fps: float, progress: Progress
) -> tuple[Speed, Config]:
    """Choose the smallest sizes for some frames; raise Impossible if none are fast enough."""
    speed = Speed(frames, progress)
    try:
        return speed, speed.choose(config, most)
    except Missed as missed:
        raise Impossible(
            f"--fps {fps:g}: {missed.half} of {missed.view} takes {missed.cycles:,} of {most:,} "
            f"cycles in the largest machine, most of them in {missed.stage}: "
            f"{fps_of(missed.cycles):.1f} frames per second at best"
        ) from None


def narrowed(search: Search, views: list[View]) -> tuple[Search, Config]:
    """Find the narrowest formats for all views; views that fail are added to the search."""
    while True:
        formats = search.run()
        others = [view for view in views if view not in search.views]
        missed = [v for v in others if v.square(v.frame(formats).pixels) > search.bound]
        if not missed:
            return search, formats
        search = search.with_view(missed[0])


@dataclass(frozen=True)
class Knob:
    """A chosen field. before: DEFAULT's value; reason: the constraint that sets it."""

    name: str
    before: int
    value: int
    reason: str


def knobs(found: Fit) -> list[Knob]:
    """All chosen fields, with reasons."""
    config = found.config
    reasons = dict.fromkeys(("width_max", "height_max"), "the largest view")
    reasons["sh_degree"] = f"the model has harmonics of degree {config.sh_degree}"
    sizes = [Knob(k, getattr(DEFAULT, k), getattr(config, k), why) for k, why in reasons.items()]
    for name, half in SIZES.items():
        before, value = (
            c.pes * c.pe_arrays if name == "pes" else getattr(c, name) for c in (DEFAULT, config)
        )
        sizes.append(Knob(name, before, value, speed_reason(found, name, half)))
    for name in SHARES:
        sizes.append(
            Knob(name, bits_of(DEFAULT, name), bits_of(config, name), format_reason(found, name))
        )
    return sizes


def speed_reason(found: Fit, name: str, half: str) -> str:
    """Reason for a size: the time that its half takes, and the time with a smaller size."""
    view, cycles = found.speed.slowest(found.config, half)
    text = f"{half} of {view} takes {millions(cycles)} of {millions(found.most)}"
    less = smaller(found.config, name)
    if less is None:
        return f"{text}; no smaller value exists"
    value = less.pes * less.pe_arrays if name == "pes" else getattr(less, name)
    view, cycles = found.speed.slowest(less, half)
    return f"{text}; {value} would take {millions(cycles)} ({view})"


def format_reason(found: Fit, name: str) -> str:
    """Reason for a format: the PSNR, and the PSNR with one bit less."""
    if found.search is None:
        return "as DEFAULT: no --psnr"
    if name not in found.search.fields:
        return "with fewer bits more splats are blended, which takes more rasterizers"
    if name not in found.search.less:
        return "the narrowest that the hardware supports"
    less = found.search.less[name]
    view, now = worst(found.errors)
    return f"{view} has {now:.2f} dB (machine) of {found.psnr:g}; with one bit less {less:.2f} dB"


def millions(cycles: int) -> str:
    """Cycles as text."""
    return f"{cycles / 1e6:.3g} M cycles"
