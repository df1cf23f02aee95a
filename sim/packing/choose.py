"""The model that a scene is packed as: the smallest that is good enough in the views given."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from splatcore.golden.reference import colours, render
from splatcore.model.gradients.drawn import blending_weights
from splatcore.model.pack.pack import format_of, pack, packing_key
from splatcore.model.pack.quality import COMPACT, LEAST_DB, STEPPED, UNLEARNED
from splatcore.model.pack.report import PackReport
from splatcore.model.pack.stored import stored_scene
from splatcore.sim.common.metric import LEVELS, against, difference, differences, psnr
from splatcore.sim.common.source import Source
from splatcore.spec.camera import Camera
from splatcore.spec.colour import COARSE, FINE, SECOND
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.memory import CHUNK, COMPACT_DEGREE, chunk_count
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene

SAME_DB = 200.0
"""Stands for the dB of equal pictures where numbers are compared."""

ROUNDS = 7  # of bisection over the chunks that get more harmonics

Tell = Callable[[str], None]  # called with the name of the step that begins


@dataclass(frozen=True, eq=False)
class Packed:
    """A scene as a model. psnr_db: "packing", of the reference's pictures of the model against
    those of the scene as it is, all harmonics, the worst of the views. camera: the first of them;
    exact, drawn: the reference's pictures of the scene and of the model to it."""

    model: PackedModel
    report: PackReport
    quality: str
    psnr_db: float | None
    camera: Camera
    exact: np.ndarray
    drawn: np.ndarray

    def metrics(self, pixels: np.ndarray) -> dict[str, float | None]:
        """Of the machine's picture to that camera: `against` machine, scene and packing."""
        found = differences(pixels, {"machine": self.drawn, "scene": self.exact})
        return against(found | {"packing": difference(self.drawn, self.exact)})


@dataclass(frozen=True, eq=False)
class Views:
    """Cameras, and what the scene as it is looks like to them."""

    cameras: Sequence[Camera]
    pictures: list[np.ndarray]

    @classmethod
    def of(cls, scene: Scene, cameras: "Sequence[Camera] | Views") -> "Views":
        """The scene in the eyes of cameras; views of it as they are."""
        if isinstance(cameras, Views):
            return cameras
        return cls(cameras, [picture(scene.gaussians(), camera) for camera in cameras])

    def psnr_db(self, gaussians: Gaussians) -> float:
        """dB of Gaussians against the scene, the worst of the views; `SAME_DB` for no error."""
        return self.least_db([picture(gaussians, camera) for camera in self.cameras])

    def least_db(self, drawn: list[np.ndarray]) -> float:
        """The same of their pictures."""
        pairs = zip(drawn, self.pictures, strict=True)
        found = [psnr(picture / LEVELS, exact / LEVELS) for picture, exact in pairs]
        return min(SAME_DB if db is None else db for db in found)

    def judged(self, model: PackedModel, report: PackReport, quality: str) -> Packed:
        """A model with its dB and pictures."""
        drawn = [picture(model.gaussians(), camera) for camera in self.cameras]
        db = self.least_db(drawn)
        return Packed(
            model, report, quality, None if db == SAME_DB else db, self.cameras[0],
            self.pictures[0], drawn[0],
        )  # fmt: skip


def picture(gaussians: Gaussians, camera: Camera) -> np.ndarray:
    """The reference's 8-bit picture."""
    return render(gaussians, camera).pixels


def packing(source: Source, truths: dict[str, np.ndarray] | None = None) -> dict | None:
    """How a source's scene was packed for a machine, last; None if it was not. truths: what the
    reference makes of model and scene, if it is to another view than what the scene was packed for.
    """
    if not source.packed:
        return None
    *_, last = source.packed.values()
    size, db = last.model.bytes_per_gaussian, last.psnr_db
    if truths:
        db = psnr(truths["machine"] / LEVELS, truths["scene"] / LEVELS)
    return {"quality": last.quality, "bytes_per_gaussian": size, "psnr_db_packing": db}


def quality_of(source: Source, config: Config, cameras: Sequence[Camera]) -> str | None:
    """The quality that is chosen for some views; None for what is packed already."""
    if source.scene is None:
        return None
    only, *more = candidates(source.scene, config)
    return choose(source.scene, config, cameras).quality if more else only


def packing_line(source: Source) -> str:
    """The same as a line for people; empty if there was nothing to pack."""
    found = packing(source)
    if found is None:
        return ""
    db = "equal" if found["psnr_db_packing"] is None else f"{found['psnr_db_packing']:.2f} dB"
    size = f"{found['bytes_per_gaussian']:.2f} bytes a Gaussian"
    return f"packed as {found['quality']}: {size}, packing {db} against the scene as it is"


def packed_model(
    source: Source, config: Config, camera: Camera, quality: str | None = None
) -> PackedModel:
    """The model that a machine renders, kept; a scene is packed for it. It may be empty."""
    return (
        source.model if source.model is not None else packed(source, config, camera, quality).model
    )


def packed(
    source: Source, config: Config, camera: Camera, quality: str | None = None, tell: Tell = str
) -> Packed:
    """A source's scene packed for a machine and a view, kept; what that loses is noted."""
    key = packing_key(config), (quality or (camera.name, camera.width, camera.height))
    if key not in source.packed:
        source.packed[key] = choose(source.scene, config, [camera], quality, tell=tell)
        for line in source.packed[key].report.notes:
            source.note(line)
    return source.packed[key]


def candidates(scene: Scene, config: Config) -> tuple[str, ...]:
    """`UNLEARNED` that a machine renders, without those that are no smaller than a better one."""
    if config.colours == "array":
        return (COMPACT,)
    degree = min(scene.sh_degree, config.sh_degree)
    return {0: ("faithful",), 3: UNLEARNED}.get(degree, (COMPACT, "faithful"))


def finest(scene: Scene, config: Config) -> str:
    """The quality for scenes whose corner counts: codebooks up to degree 1, else the best."""
    return COMPACT if scene.sh_degree <= COMPACT_DEGREE else candidates(scene, config)[-1]


def choose(
    scene: Scene, config: Config, cameras: Sequence[Camera] | Views, quality: str | None = None,
    least: float = LEAST_DB, tell: Tell = str,
) -> Packed:  # fmt: skip
    """The smallest of `UNLEARNED` with at least `least` dB in all views, or the best; or the one
    that is asked for."""
    views = Views.of(scene, cameras)
    names = [quality] if quality else list(candidates(scene, config))
    if len(names) > 1 and scene.sh_degree > COMPACT_DEGREE:
        cut = scene.with_sh_degree(COMPACT_DEGREE).gaussians()
        if views.psnr_db(cut) < least:  # codebooks can only be worse
            names.remove(COMPACT)
    for name in names:
        tell(f"packing: {name}")
        found = views.judged(*pack(scene, config, quality=name), name)
        if enough(found, least):
            break
    return found


def smallest(
    scene: Scene, config: Config, cameras: Sequence[Camera] | Views, least: float, tell: Tell = str
) -> Packed:
    """The smallest model with at least `least` dB in all views, or the best that there is.

    Beyond the compact one: a model in steps, whose chunks get further beats in the order of what a
    beat takes off their error in these views; of that order the shortest beginning that suffices.
    """
    views = Views.of(scene, cameras)
    first = choose(scene, config, views, candidates(scene, config)[0], least, tell)
    if enough(first, least) or config.colours == "array":
        return first
    steps = upgrades(scene, config, views.cameras, tell)
    plain = np.zeros(chunk_count(len(stepped(scene, config))), np.int64)

    def of(count: int) -> Packed:
        tell(f"packing: {count} of {len(steps)} steps")
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


def enough(packed: Packed, least: float) -> bool:
    """True if a model reaches so many dB."""
    return packed.psnr_db is None or packed.psnr_db >= least


def upgrades(
    scene: Scene, config: Config, cameras: Sequence[Camera], tell: Tell
) -> list[tuple[int, int]]:
    """Chunks and the layouts that they get one after the other, what takes off most first.

    A chunk's error with a layout is Σ weight · squared error of its Gaussians' colours, as the
    cameras see them; weight: the Gaussian's share of the pictures.
    """
    stored = stepped(scene, config)
    degree = min(scene.sh_degree, config.sh_degree)
    kinds = {0: (), 3: (COARSE, FINE)}.get(degree, (SECOND,))
    of = np.arange(len(stored)) // CHUNK
    chunks = chunk_count(len(stored))
    tell("weighing Gaussians")
    exact = stored.gaussians()
    weights = list(blending_weights(exact, cameras))
    errors = []
    for kind in (0, *kinds):
        tell(f"weighing chunks: {len(errors) + 1} of {1 + len(kinds)}")
        model, _ = pack(scene, config, quality=np.full(chunks, kind))
        error = seen_error(exact, model.gaussians(), weights, cameras)
        errors.append(np.bincount(of, error, chunks))
    found, most = [], np.full(chunks, np.inf)
    for kind, before, after in zip(kinds, errors, errors[1:], strict=False):
        most = np.minimum(most, before - after)  # a chunk's second step comes after its first
        found += [(-gain, kind, chunk) for chunk, gain in enumerate(most) if gain > 0]
    return [(chunk, kind) for _, kind, chunk in sorted(found)]


def stepped(scene: Scene, config: Config) -> Scene:
    """The scene as it is stored in models in steps."""
    return stored_scene(scene, format_of(config, STEPPED[0], scene.sh_degree)).scene


def seen_error(
    exact: Gaussians, packed: Gaussians, weights: list[np.ndarray], cameras: Sequence[Camera]
) -> np.ndarray:
    """Σ over the cameras of weight · squared error of the colour, [N]. What a camera does not see
    has no colour: at its own place there is no direction."""
    total = np.zeros(len(packed))
    for weight, camera in zip(weights, cameras, strict=True):
        index = np.flatnonzero(weight)
        seen = [colours(gaussians, index, camera, SPLATCORE) for gaussians in (exact, packed)]
        total[index] += weight[index] * ((seen[0] - seen[1]) ** 2).sum(1)
    return total
