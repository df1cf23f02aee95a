"""Choice of a scene's packed model: the smallest with enough PSNR in the given views."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from splatcore.golden.reference import colours, render
from splatcore.model.gradients.drawn import blending_weights
from splatcore.model.pack.pack import format_of, pack
from splatcore.model.pack.quality import COMPACT, LEAST_DB, STEPPED, UNLEARNED
from splatcore.model.pack.report import PackReport
from splatcore.model.pack.stored import stored_scene
from splatcore.sim.frame.metric import LEVELS, against, difference, differences, psnr
from splatcore.spec.camera import Camera
from splatcore.spec.colour import COARSE, FINE, SECOND
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.memory import CHUNK, COMPACT_DEGREE, chunk_count
from splatcore.spec.packed import Drawn, PackedModel
from splatcore.spec.scene import LARGE, Gaussians, Scene

SAME_DB = 200.0
"""PSNR in dB that equal pictures count as in comparisons."""

ROUNDS = 7  # of bisection over the number of chunks that get more harmonics

Progress = Callable[[str], None]  # called with the name of the step that begins


@dataclass(frozen=True, eq=False)
class Packed:
    """A scene's packed model, the report of its losses, and its quality."""

    model: PackedModel
    report: PackReport
    quality: str


@dataclass(frozen=True, eq=False)
class Judged(Packed):
    """A packed model and the loss of packing in some views.

    psnr_db: reference on the model against reference on the scene as trained, the worst of the
        views; None for equal pictures
    camera: of the first view
    exact, drawn: the reference's 8-bit pictures of scene and model in that view
    """

    psnr_db: float | None
    camera: Camera
    exact: np.ndarray
    drawn: np.ndarray

    def metrics(self, pixels: np.ndarray) -> dict[str, float | None]:
        """Metrics of the machine's picture of the first view: machine, scene and packing."""
        found = differences(pixels, {"machine": self.drawn, "scene": self.exact})
        return against(found | {"packing": difference(self.drawn, self.exact)})


@dataclass(frozen=True, eq=False)
class Views:
    """Cameras, and the reference's 8-bit pictures of the scene as trained."""

    cameras: Sequence[Camera]
    pictures: list[np.ndarray]

    @classmethod
    def of(cls, scene: Scene, cameras: "Sequence[Camera] | Views") -> "Views":
        """Render the scene for cameras; `Views` are returned unchanged."""
        if isinstance(cameras, Views):
            return cameras
        return cls(cameras, pictures(scene, cameras))

    def psnr_db(self, drawn: Drawn) -> float:
        """PSNR in dB of Gaussians against the scene, the worst view's; `SAME_DB` if equal."""
        return self.least_db(pictures(drawn, self.cameras))

    def least_db(self, drawn: list[np.ndarray]) -> float:
        """PSNR in dB of 8-bit pictures of all views, as in `psnr_db`."""
        pairs = zip(drawn, self.pictures, strict=True)
        found = [psnr(picture / LEVELS, exact / LEVELS) for picture, exact in pairs]
        return min(SAME_DB if db is None else db for db in found)

    def judged(self, model: PackedModel, report: PackReport, quality: str) -> Judged:
        """Render a model in all views and add its PSNR."""
        drawn = pictures(model, self.cameras)
        db = self.least_db(drawn)
        return Judged(
            model, report, quality, None if db == SAME_DB else db, self.cameras[0],
            self.pictures[0], drawn[0],
        )  # fmt: skip


def pictures(drawn: Drawn, cameras: Sequence[Camera]) -> list[np.ndarray]:
    """The reference's 8-bit pictures. Large scenes and models are decoded for each, in batches."""
    if not isinstance(drawn, Gaussians) and len(drawn) <= LARGE:
        drawn = drawn.gaussians()
    return [render(drawn, camera).pixels for camera in cameras]


def packed(
    scene: Scene, config: Config, camera: Camera, quality: str | None = None,
    progress: Progress = str,
) -> Packed:  # fmt: skip
    """Pack a scene, in a quality or in the smallest that is good enough in a view."""
    only, *more = [quality] if quality else candidates(scene, config)
    if more:
        return choose(scene, config, [camera], progress=progress)
    progress(f"packing: {only}")
    return Packed(*pack(scene, config, quality=only), only)


def quality_of(scene: Scene, config: Config, cameras: Sequence[Camera]) -> str:
    """The quality that is chosen for some views."""
    only, *more = candidates(scene, config)
    return choose(scene, config, cameras).quality if more else only


def candidates(scene: Scene, config: Config) -> tuple[str, ...]:
    """Qualities of `UNLEARNED` that a machine renders and that are smaller than all better ones."""
    if config.colours == "array":
        return (COMPACT,)
    degree = min(scene.sh_degree, config.sh_degree)
    return {0: ("faithful",), 3: UNLEARNED}.get(degree, (COMPACT, "faithful"))


def finest(scene: Scene, config: Config) -> str:
    """The quality in which hard cases are packed: compact up to degree 1, else the best."""
    return COMPACT if scene.sh_degree <= COMPACT_DEGREE else candidates(scene, config)[-1]


def choose(
    scene: Scene, config: Config, cameras: Sequence[Camera] | Views, quality: str | None = None,
    least: float = LEAST_DB, progress: Progress = str,
) -> Judged:  # fmt: skip
    """Pack a scene in the smallest quality of `UNLEARNED` that is good enough.

    quality: the quality to use instead
    least: PSNR in dB required in all views; if no quality reaches it, the best is taken
    """
    views = Views.of(scene, cameras)
    names = [quality] if quality else list(candidates(scene, config))
    if len(names) > 1 and scene.sh_degree > COMPACT_DEGREE:
        cut = scene.with_sh_degree(COMPACT_DEGREE)
        if views.psnr_db(cut) < least:  # codebooks can only be worse
            names.remove(COMPACT)
    for name in names:
        progress(f"packing: {name}")
        found = views.judged(*pack(scene, config, quality=name), name)
        if enough(found, least):
            break
    return found


def smallest(
    scene: Scene, config: Config, cameras: Sequence[Camera] | Views, least: float,
    progress: Progress = str,
) -> Judged:  # fmt: skip
    """Pack the smallest model with at least `least` dB in all views, or the best one.

    If the compact model is not enough: a stepped model, whose chunks get additional beats. The
    beats are ordered by how much they reduce the error in these views; bisection finds how many
    of them are needed.
    """
    views = Views.of(scene, cameras)
    first = choose(scene, config, views, candidates(scene, config)[0], least, progress)
    if enough(first, least) or config.colours == "array":
        return first
    steps = upgrades(scene, config, views.cameras, progress)
    plain = np.zeros(chunk_count(len(stepped(scene, config))), np.int64)

    def of(count: int) -> Judged:
        progress(f"packing: {count} of {len(steps)} steps")
        layouts = plain.copy()
        for chunk, layout in steps[:count]:
            layouts[chunk] = layout
        return views.judged(*pack(scene, config, quality=layouts), f"{least:g} dB")

    low, high, best = 0, len(steps), of(len(steps))
    for _ in range(ROUNDS if enough(best, least) else 0):
        middle = (low + high) // 2
        found = of(middle)
        if enough(found, least):
            high, best = middle, found
        else:
            low = middle + 1
        if low >= high:
            break
    return best


def enough(packed: Judged, least: float) -> bool:
    """True if a model reaches `least` dB."""
    return packed.psnr_db is None or packed.psnr_db >= least


def upgrades(
    scene: Scene, config: Config, cameras: Sequence[Camera], progress: Progress
) -> list[tuple[int, int]]:
    """(chunk, layout) upgrades, ordered by how much each reduces the error, most first.

    A chunk's error with a layout is Σ weight · squared error of its Gaussians' colours, as the
    cameras see them. weight: the Gaussian's share of the pictures.
    """
    stored = stepped(scene, config)
    degree = min(scene.sh_degree, config.sh_degree)
    kinds = {0: (), 3: (COARSE, FINE)}.get(degree, (SECOND,))
    of = np.arange(len(stored)) // CHUNK
    chunks = chunk_count(len(stored))
    progress("weighing Gaussians")
    exact = stored.gaussians()
    weights = list(blending_weights(exact, cameras))
    errors = []
    for kind in (0, *kinds):
        progress(f"weighing chunks: {len(errors) + 1} of {1 + len(kinds)}")
        model, _ = pack(scene, config, quality=np.full(chunks, kind))
        error = seen_error(exact, model.gaussians(), weights, cameras)
        errors.append(np.bincount(of, error, chunks))
    found, most = [], np.full(chunks, np.inf)
    for kind, before, after in zip(kinds, errors, errors[1:], strict=False):
        most = np.minimum(most, before - after)  # a chunk's second step comes after its first
        found += [(-gain, kind, chunk) for chunk, gain in enumerate(most) if gain > 0]
    return [(chunk, kind) for _, kind, chunk in sorted(found)]


def stepped(scene: Scene, config: Config) -> Scene:
    """The scene as stored in stepped models."""
    return stored_scene(scene, format_of(config, STEPPED[0], scene.sh_degree)).scene


def seen_error(
    exact: Gaussians, packed: Gaussians, weights: list[np.ndarray], cameras: Sequence[Camera]
) -> np.ndarray:
    """Σ over the cameras of weight · squared error of the colour, [N].

    Gaussians of weight 0 are skipped: one at the camera's own position has no view direction.
    """
    total = np.zeros(len(packed))
    for weight, camera in zip(weights, cameras, strict=True):
        index = np.flatnonzero(weight)
        seen = [colours(gaussians, index, camera, SPLATCORE) for gaussians in (exact, packed)]
        total[index] += weight[index] * ((seen[0] - seen[1]) ** 2).sum(1)
    return total
