"""Writing SOG version 2: a zip of WebP images and meta.json.

Source: PlayCanvas, "The SOG Format". As in splat-transform's files, Gaussian i is pixel i of images
whose sides are multiples of 4, and meta.json comes last. Colours and scales share codebooks of 256
numbers; harmonics are rows of a palette of up to 65,536.
"""

import io
import json
import os
import zipfile

import numpy as np
from PIL import Image

from splatcore.model.export.quaternion import smallest_three
from splatcore.model.formats import file
from splatcore.model.formats.ply import log_scales
from splatcore.model.formats.sog import CODEBOOK_MAX, PALETTE_ROW, QUATERNION_TAG
from splatcore.model.pack.codebook import cluster
from splatcore.spec.scene import Scene

PALETTE_MAX = 1 << 16  # labels have 16 bits

COARSE = 256  # clusters that are divided into the palette; clustering all at once takes hours

BINS = 1 << 14  # into which the numbers of a codebook are counted


def write(path: str | os.PathLike, scene: Scene) -> None:
    """Write a scene."""
    width = -(-int(np.ceil(np.sqrt(len(scene)))) // 4) * 4
    height = -(-len(scene) // (4 * width)) * 4
    images, meta = _parts(scene)
    with file.reading(path, "cannot be written"), zipfile.ZipFile(path, "w") as archive:
        for name, pixels in images.items():
            if name != "shN_centroids":
                whole = np.zeros((height * width, 4), np.uint8)
                whole[: len(pixels)] = pixels
                pixels = whole.reshape(height, width, 4)
            archive.writestr(f"{name}.webp", _webp(pixels))
        archive.writestr("meta.json", json.dumps(meta))


def _webp(pixels: np.ndarray) -> bytes:
    """Encode pixels [height, width, 4] without loss, also where alpha is 0."""
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "WEBP", lossless=True, exact=True)
    return data.getvalue()


def _parts(scene: Scene) -> tuple[dict[str, np.ndarray], dict]:
    """Return images by name, pixels [N, 4] each but [rows, width, 4] of the palette; meta.json."""
    sh = np.asarray(scene.sh, np.float64)
    logarithm = np.sign(scene.position) * np.log1p(np.abs(scene.position))
    low, high = logarithm.min(axis=0), logarithm.max(axis=0)
    step = np.where(high > low, (high - low) / 65535, 1)
    means = np.rint((logarithm - low) / step).astype(np.int64)
    largest, others = smallest_three(scene.quaternion)
    scales, scale_codes = codebook(log_scales(scene))
    colours, colour_codes = codebook(sh[:, 0])
    images = {
        "means_l": _pixels(means & 255),
        "means_u": _pixels(means >> 8),
        "quats": _pixels(np.rint((others / np.sqrt(2) + 0.5) * 255), QUATERNION_TAG + largest),
        "scales": _pixels(scale_codes),
        "sh0": _pixels(colour_codes, np.rint(scene.opacity * 255)),
    }
    meta = {
        "version": 2,
        "asset": {"generator": "Splatcore"},
        "count": len(scene),
        "antialias": scene.antialiased,
        "means": {"mins": low.tolist(), "maxs": high.tolist()} | _files("means_l", "means_u"),
        "scales": {"codebook": scales} | _files("scales"),
        "quats": _files("quats"),
        "sh0": {"codebook": colours} | _files("sh0"),
    }
    if scene.antialiased:
        meta["model"] = "antialiased"  # splat-transform's key; "antialias" is the format's
    if scene.sh_degree:
        rows, labels = palette(sh[:, 1:].reshape(len(scene), -1))
        numbers, codes = codebook(rows)
        coefficients = scene.sh.shape[1] - 1
        whole = np.zeros((-(-len(rows) // PALETTE_ROW) * PALETTE_ROW * coefficients, 3))
        whole[: len(rows) * coefficients] = codes.reshape(-1, 3)
        images["shN_centroids"] = _pixels(whole).reshape(-1, PALETTE_ROW * coefficients, 4)
        images["shN_labels"] = _pixels(np.stack([labels & 255, labels >> 8, 0 * labels], axis=1))
        meta["shN"] = {"count": len(rows), "bands": scene.sh_degree, "codebook": numbers}
        meta["shN"] |= _files("shN_centroids", "shN_labels")
    return images, meta


def _files(*names: str) -> dict[str, list[str]]:
    return {"files": [f"{name}.webp" for name in names]}


def _pixels(rgb: np.ndarray, alpha: np.ndarray | int = 255) -> np.ndarray:
    """Return pixels [N, 4] of numbers 0 … 255: RGB [N, 3] and alpha [N]."""
    return np.column_stack([rgb, np.broadcast_to(alpha, len(rgb))]).astype(np.uint8)


def codebook(values: np.ndarray) -> tuple[list[float], np.ndarray]:
    """Return up to 256 ascending numbers, and the index of the nearest one for each value.

    More than 256 values are counted in bins, and the bins clustered by k-means. Their weight is the
    square root of the count, so that rare values keep small errors, too.
    """
    distinct = np.unique(values)
    if len(distinct) > CODEBOOK_MAX:
        count, edges = np.histogram(values, BINS)
        centres = ((edges[1:] + edges[:-1]) / 2)[count > 0]
        found, _ = cluster(centres[:, None], CODEBOOK_MAX - 2, 0, np.sqrt(count[count > 0]))
        distinct = np.unique([distinct[0], *found[:, 0], distinct[-1]])
    above = np.searchsorted((distinct[1:] + distinct[:-1]) / 2, values)
    return distinct.tolist(), above


def palette(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return up to 65,536 rows [P, D], and the index of the one that stands for each row [N].

    Different rows up to that number are kept exactly. Others are divided into `COARSE` clusters,
    each of which gets its share of the palette.
    """
    distinct, index = np.unique(rows, axis=0, return_inverse=True)
    if len(distinct) <= PALETTE_MAX:
        return distinct, index.reshape(-1)
    _, coarse = cluster(rows, COARSE, 0)
    found, labels, used = [], np.empty(len(rows), np.int64), 0
    for number in range(COARSE):
        members = np.flatnonzero(coarse == number)
        if len(members):
            share = max(len(members) * (PALETTE_MAX - COARSE) // len(rows), 1)
            centres, nearest = cluster(rows[members], share, 0)
            labels[members] = used + nearest
            found.append(centres)
            used += share
    return np.concatenate(found), labels
