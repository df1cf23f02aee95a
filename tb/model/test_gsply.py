"""Scenes exchanged with gsply 0.4.6, number by number: PLY, compressed PLY, SPZ.

gsply decodes for some of our readers; here its own functions read and write the whole files.
"""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.export.writers import WRITERS, prepared
from splatcore.model.formats.file import sigmoid
from splatcore.model.formats.read import read_scene
from splatcore.model.formats.spz_axes import turned
from splatcore.spec.scene import Scene
from tb.helpers.scenes import random_scene

LOSS = {".ply": 2e-6, ".compressed.ply": 0.02, ".spz": 0.03}
"""Largest errors of compressed files, both with 8 bits of harmonics."""


@pytest.fixture(params=range(4))
def scene(request) -> Scene:
    scene = random_scene(300, request.param)
    return replace(scene, sh=scene.sh / 2, antialiased=bool(request.param % 2))


def check(found: Scene, wanted: Scene, tolerance: float = 2e-6):
    """Numbers in file order; quaternions with either sign."""
    quaternion = found.quaternion / np.linalg.norm(found.quaternion, axis=1, keepdims=True)
    sign = np.sign((quaternion * wanted.quaternion).sum(axis=1, keepdims=True))
    assert len(found) == len(wanted) and found.sh.shape == wanted.sh.shape
    for name, values in (
        ("position", found.position), ("scale", found.scale), ("opacity", found.opacity),
        ("sh", found.sh), ("quaternion", quaternion * sign),
    ):  # fmt: skip
        error = np.abs(values - getattr(wanted, name)).max()
        assert error <= tolerance, (name, error)


def of_gsply(data) -> Scene:
    """A scene of gsply's arrays: logarithms of scales, logits of opacities."""
    higher = np.zeros((len(data.means), 0, 3)) if data.shN is None else data.shN
    sh = np.concatenate([data.sh0[:, None], higher], axis=1)
    return Scene(data.means, np.exp(data.scales), data.quats, sigmoid(data.opacities), sh)


def to_gsply(scene: Scene):
    import gsply

    logit = np.log(scene.opacity / (1 - scene.opacity))
    arrays = (scene.position, np.log(scene.scale), scene.quaternion, logit, scene.sh[:, 0])
    higher = scene.sh[:, 1:].astype(np.float32) if scene.sh_degree else None
    return gsply.GSData(*(np.ascontiguousarray(each, np.float32) for each in arrays), higher)


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".spz"])
def test_it_reads_our_files(tmp_path, scene, suffix):
    """It ignores the axes and the mark of an SPZ file, which holds RUB."""
    import gsply

    path, writer = tmp_path / f"a{suffix}", WRITERS[suffix]
    scene, _ = prepared(scene, writer)
    writer.write(path, scene)
    found = of_gsply((gsply.read_spz if suffix == ".spz" else gsply.plyread)(path))
    if suffix == ".spz":
        found = turned(found, "RUB")
    check(found, read_scene(path))
    check(found, scene, LOSS[suffix])


@pytest.mark.parametrize("suffix", LOSS)
def test_its_files_are_read(tmp_path, scene, suffix):
    """Its SPZ holds the numbers of the PLY, in RDF axes, which it does not state."""
    import gsply

    path, data = tmp_path / f"a{suffix}", to_gsply(scene)
    if suffix == ".spz":
        gsply.write_spz(path, data, version=4)
    else:
        gsply.plywrite(path, data, compressed=suffix != ".ply")
    found = read_scene(path, "RDF" if suffix == ".spz" else None)
    check(found, scene, LOSS[suffix])
    again = of_gsply((gsply.read_spz if suffix == ".spz" else gsply.plyread)(path))
    check(found, again)


def test_its_spz_3_is_read(tmp_path, scene):
    import gsply

    gsply.write_spz(tmp_path / "a.spz", to_gsply(scene), version=3)
    check(read_scene(tmp_path / "a.spz", "RDF"), scene, LOSS[".spz"])
