"""SOG scenes (meta.json and WebP images, in a zip archive or in a folder), versions 1 and 2.

Source: PlayCanvas, "The SOG Format". Pixel i of an image, row by row, belongs to Gaussian i.
Version 2 looks up bytes in a codebook; version 1 maps them linearly to `mins` … `maxs`.
"""

import io
import json
import os
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from splatcore.model.formats import file
from splatcore.model.formats.file import input_error
from splatcore.model.formats.sog_files import META, Unbundled, Zipped, open_files
from splatcore.spec.scene import Scene

PALETTE_ROW = 64  # SH vectors per row of the centroids image

QUATERNION_TAG = 252
"""The alpha of a quaternion's pixel is this plus the index of its largest component."""

CODEBOOK_MAX = 256

MARKS = {"model": {"antialiased": True, "default": False}, "antialias": {True: True, False: False}}
"""Keys of meta.json that say whether a scene is antialiased, with their values."""

_COEFFICIENTS = {1: 3, 2: 8, 3: 15}  # SH degree → coefficients per channel beyond the constant one


@dataclass(frozen=True)
class Sog:
    """An open SOG scene."""

    files: Zipped | Unbundled
    meta: dict  # content of meta.json
    version: int

    @property
    def path(self) -> str | os.PathLike:
        return self.files.path

    def section(self, name: str) -> tuple[dict, str]:
        """An object of meta.json, and its location for messages."""
        return file.field(self.meta, name, dict, self.files.where(META)), f"{self.path}: {name}"

    def pixels(self, name: str, index: int = 0) -> np.ndarray:
        """Image `index` of a section as uint8 [height, width, 4]."""
        section, where = self.section(name)
        files = file.field(section, "files", list, where)
        if index >= len(files):
            raise input_error(where, f"'files' has {len(files)} entries, not {index + 1}")
        name = file.checked(files[index], str, f"{where}: 'files'")
        data, where = self.files.read(name), self.files.where(name)
        with file.reading(where, "is not a WebP or PNG image"):
            image = Image.open(io.BytesIO(data), formats=("WEBP", "PNG"))
        if image.mode not in ("RGB", "RGBA"):
            raise input_error(where, f"has pixels of mode {image.mode}, not RGB or RGBA")
        file.check_expansion(4 * image.width * image.height, self.files.size, where)
        with file.reading(where, "is a broken image"):
            return np.asarray(image.convert("RGBA"))  # a missing alpha becomes 255

    def values(self, name: str, codes: np.ndarray) -> np.ndarray:
        """Dequantised bytes [N, C] of a section, float64."""
        section, where = self.section(name)
        if self.version == 1:
            shape = () if name == "shN" else (codes.shape[-1],)
            low, high = (file.array_field(section, side, shape, where) for side in ("mins", "maxs"))
            return low + (high - low) * (codes / 255)
        codebook = _codebook(section, where)
        if codes.max(initial=0) >= len(codebook):
            raise input_error(where, f"index {codes.max()} is outside its 'codebook'")
        return codebook[codes]


def read(path: str | os.PathLike) -> Scene:
    """Read the scene of a SOG file, or of a meta.json with its images in the same folder."""
    files, meta = open_files(path)
    version = file.field(meta, "version", int, path, default=1)
    if version not in (1, 2):
        raise input_error(path, f"SOG version {version} is not supported")
    sog = Sog(files, meta, version)
    images = {name: sog.pixels(name) for name in ("means", "quats", "scales", "sh0")}
    images["means, upper bytes"] = sog.pixels("means", 1)
    labels = None
    if "shN" in sog.meta:
        labels = images["shN, labels"] = sog.pixels("shN", 1)
    size = images["means"].shape
    for name, image in images.items():
        if image.shape != size:
            raise input_error(
                path, f"{name} is {image.shape[1]}×{image.shape[0]}, not {size[1]}×{size[0]}"
            )
    count = _count(sog)
    if count > size[0] * size[1]:
        raise input_error(path, f"{count} Gaussians exceed images of {size[1]}×{size[0]} pixels")
    file.check_count(count, path)
    pixels = {name: image.reshape(-1, 4)[:count] for name, image in images.items()}
    centroids = None if labels is None else _centroids(sog)

    def convert(some: slice) -> Scene:
        rows = {name: each[some] for name, each in pixels.items()}
        opacity, colour = _colour(sog, rows["sh0"])
        higher = None if labels is None else centroids[_labels(rows["shN, labels"], centroids)]
        position = _position(sog, rows["means"], rows["means, upper bytes"])
        log_scale = sog.values("scales", rows["scales"][:, :3])
        quaternion = _quaternion(sog, rows["quats"], some.start)
        return file.stored_scene(path, position, log_scale, quaternion, opacity, colour, higher)

    scene = file.in_batches(count, convert)
    notes = () if labels is None else _lost(pixels["shN, labels"], centroids)
    return _marked(replace(scene, notes=notes + _surplus(images, count)), meta)


def _surplus(images: dict[str, np.ndarray], count: int) -> tuple[str, ...]:
    """A note on pixels after the last Gaussian that are Gaussians, too: unlike padding they have an
    opacity above 0 and the tag of a quaternion."""
    opacity, tag = (images[name].reshape(-1, 4)[count:, 3] for name in ("sh0", "quats"))
    held = int(((opacity > 0) & (tag >= QUATERNION_TAG)).sum())
    says = f"meta.json says {count} Gaussians, its images hold {count + held}"
    return (f"{says}: the rest is not read",) if held else ()


def _marked(scene: Scene, meta: dict) -> Scene:
    """The scene with the mark stated at the top level of meta.json, if any: by "model" (PlayCanvas'
    splat-transform) or "antialias" (GaussForge)."""
    for key, stated in MARKS.items():
        value = meta.get(key)
        if isinstance(value, str | bool) and value in stated:
            mark = f'SOG "{key}": {json.dumps(value)}'
            return replace(scene, antialiased=stated[value], mark=mark)
    return scene


def _codebook(section: dict, where: str) -> np.ndarray:
    """The codebook of a section, up to 256 numbers."""
    numbers = list(file.field(section, "codebook", list, where))
    if not 1 <= len(numbers) <= CODEBOOK_MAX:
        raise input_error(where, f"'codebook' has {len(numbers)} entries, not 1 … {CODEBOOK_MAX}")
    if numbers[0] is None and len(numbers) == CODEBOOK_MAX:
        # A bug of early writers; the entry is extrapolated as in PlayCanvas's engine.
        second, last = (file.checked(numbers[i], float, f"{where}: 'codebook'") for i in (1, -1))
        numbers[0] = second + (second - last) / 255
    return file.array_field({"codebook": numbers}, "codebook", (len(numbers),), where)


def _count(sog: Sog) -> int:
    """The number of Gaussians."""
    if sog.version == 2:
        return file.field(sog.meta, "count", int, sog.files.where(META))
    means, where = sog.section("means")
    shape = file.field(means, "shape", list, where)
    if not shape:
        raise input_error(where, "'shape' is empty")
    return file.checked(shape[0], int, f"{where}: 'shape'")


def _position(sog: Sog, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Positions [N, 3] in scene units, from 16-bit codes of sign(x)·ln(1 + |x|)."""
    means, where = sog.section("means")
    low, high = (file.array_field(means, side, (3,), where) for side in ("mins", "maxs"))
    codes = lower[:, :3] + 256.0 * upper[:, :3]
    logarithm = low + (high - low) * (codes / 65535)
    return np.sign(logarithm) * (np.exp(np.abs(logarithm)) - 1)


def _quaternion(sog: Sog, rows: np.ndarray, first: int) -> np.ndarray:
    """Quaternions [N, 4] (w, x, y, z) of Gaussians `first` …: three components within ± 1/√2 are
    stored, the largest follows from the norm."""
    largest = rows[:, 3].astype(np.int64) - QUATERNION_TAG
    if (largest < 0).any():
        index = int(np.argmax(largest < 0))
        raise input_error(
            sog.path, f"quats: Gaussian {first + index} has the wrong tag {rows[index, 3]}"
        )
    small = (rows[:, :3] / 255 - 0.5) * np.sqrt(2)
    quaternion = np.empty((len(rows), 4))
    # The three keep their order and fill the places around the largest one.
    free = np.arange(4) != largest[:, None]
    quaternion[free] = small.ravel()
    quaternion[~free] = np.sqrt(np.maximum(0, 1 - (small**2).sum(axis=1)))
    return quaternion


def _colour(sog: Sog, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Opacities [N] and SH coefficients of degree 0 [N, 3]."""
    if sog.version == 1:
        values = sog.values("sh0", rows)
        return file.sigmoid(values[:, 3]), values[:, :3]
    return rows[:, 3] / 255, sog.values("sh0", rows[:, :3])


def _centroids(sog: Sog) -> np.ndarray:
    """SH coefficients from degree 1 on, [P + 1, 3 | 8 | 15, 3]: P centroids, and zeros."""
    section, where = sog.section("shN")
    image = sog.pixels("shN")
    height, width, _ = image.shape
    if sog.version == 2:
        coefficients = _COEFFICIENTS.get(file.field(section, "bands", int, where))
        count = file.field(section, "count", int, where)
    else:
        coefficients, count = width // PALETTE_ROW, PALETTE_ROW * height
        claim = file.field(section, "shape", list, where, [0, coefficients])[1:2]
        if claim not in ([], [coefficients], [3 * coefficients]):  # writers differ
            raise input_error(where, f"'shape' does not match {coefficients} coefficients")
    if coefficients not in _COEFFICIENTS.values():
        raise input_error(where, "SH degree is not 1, 2 or 3")
    if width != PALETTE_ROW * coefficients or not 1 <= count <= PALETTE_ROW * height:
        raise input_error(
            where, f"{count} × {coefficients} centroids do not match {width}×{height} pixels"
        )
    codes = image[..., :3].reshape(-1, 3 * coefficients)[:count]
    values = sog.values("shN", codes).reshape(count, coefficients, 3)
    return np.concatenate([values, np.zeros((1, coefficients, 3))])


def _labels(rows: np.ndarray, centroids: np.ndarray) -> np.ndarray:
    """Indices [N] into the centroids. Labels without a centroid stand for the zeros after them:
    splat-transform writes label 65535 for a Gaussian whose harmonics are NaN."""
    return np.minimum(rows[:, 0] + 256 * rows[:, 1].astype(np.int64), len(centroids) - 1)


def _lost(rows: np.ndarray, centroids: np.ndarray) -> tuple[str, ...]:
    """A note on labels without a centroid, if any."""
    count = len(centroids) - 1
    if not (lost := int((_labels(rows, centroids) == count).sum())):
        return ()
    some, their = ("Gaussian has", "its") if lost == 1 else ("Gaussians have", "their")
    note = f"{lost} {some} a label beyond the {count} centroids"
    return (f"{note}: {their} harmonics are 0",)
