"""Scenes exchanged with PlayCanvas' splat-transform 3.7.0, number by number. Runs only where that
program is on PATH: npm install -g @playcanvas/splat-transform@3.7.0."""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from splatcore.model.export.loss import losses
from splatcore.model.export.writers import WRITERS, prepared
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.model.formats.spz_axes import turned
from splatcore.spec.scene import Scene
from tb.helpers.refusal import refused
from tb.helpers.scenes import SCENES, random_scene

PROGRAM, VERSION = "splat-transform", "v3.7.0"


def version() -> str:
    """The version of the program on PATH; empty: there is none."""
    if shutil.which(PROGRAM) is None:
        return ""
    done = subprocess.run([PROGRAM, "--version"], capture_output=True, text=True)
    return done.stdout + done.stderr


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(VERSION not in version(), reason=f"needs {PROGRAM} {VERSION} on PATH"),
]

LEICA = SCENES / "leica-sofort-top8192.ply"

FIELDS = ("position", "scale", "rotation", "opacity", "colour", "harmonics")

THEIRS = {
    ".ply": (1e-5, 1e-3, 1e-4, 1e-6, 1e-6, 1e-6),
    ".compressed.ply": (0.02, 1.2, 0.25, 0.0021, 0.02, 0.0158),
    ".spz": (2.2e-4, 3.2, 0.25, 0.0021, 2.8, 0.07),
    ".sog": (2e-3, 13, 1.8, 0.004, 0.04, 0.03),
    "/meta.json": (2e-3, 13, 1.8, 0.004, 0.04, 0.03),
    "/lod-meta.json": (2e-3, 13, 1.8, 0.004, 0.04, 0.03),
    ".glb": (1e-5, 1e-3, 1e-4, 1e-6, 1e-6, 1e-6),
    ".splat": (1e-5, 1e-3, 1.8, 0.004, 10, 0),
}
"""The files that splat-transform writes, and the largest error of each of `FIELDS`, in the units of
`losses`. Harmonics of SPZ have 4 bits; colours of SPZ and .splat have a narrow range."""


def transform(source: Path, target: Path) -> Path:
    """Convert a scene by splat-transform, without a GPU; return the target."""
    words = [PROGRAM, "--overwrite", "--gpu", "cpu", str(source), str(target)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return target


def matched(scene: Scene, stored: Scene) -> Scene:
    """The Gaussians of a scene in the order in which a file stores them."""
    features = [
        np.hstack([each.position, np.log(each.scale) / 50, each.opacity[:, None] / 5])
        for each in (scene, stored)
    ]
    _, index = cKDTree(features[0]).query(features[1])
    assert len(np.unique(index)) == len(scene)
    return scene[index]


@pytest.fixture(params=["random", pytest.param("leica", marks=pytest.mark.scenes)])
def scene(request) -> Scene:
    if request.param == "random":
        found = random_scene(2048, 3)  # as many as its SOG has rows in the palette
        return replace(found, sh=found.sh / 2)
    if not LEICA.is_file():
        pytest.skip("needs the real scenes: set SPLATCORE_SCENES")
    return read_scene(LEICA)


@pytest.mark.parametrize("suffix", THEIRS)
def test_its_files_are_read(scene, suffix, tmp_path):
    """Its SPZ holds the numbers of the PLY, in RDF axes, which it does not state."""
    write_ply(tmp_path / "scene.ply", scene)
    (tmp_path / "out").mkdir()  # for names that begin with /
    path = transform(tmp_path / "scene.ply", Path(f"{tmp_path / 'out'}{suffix}"))
    stored = read_scene(path, "RDF" if suffix == ".spz" else None)
    assert len(stored) == len(scene)
    scene, _ = prepared(scene.with_sh_degree(stored.sh_degree), WRITERS[".ply"])
    if suffix.endswith((".compressed.ply", ".sog", "meta.json")):  # in another order
        scene = matched(scene, stored)
    largest = {name: error["largest"] for name, error in losses(scene, stored).items()}
    bounds = dict(zip(FIELDS, THEIRS[suffix], strict=True))
    wrong = {name: error for name, error in largest.items() if error > bounds[name]}
    assert not wrong


@pytest.mark.parametrize("suffix", [".csv", ".html"])
def test_its_other_files_are_refused(suffix, tmp_path):
    write_ply(tmp_path / "scene.ply", random_scene(9, 1))
    path = transform(tmp_path / "scene.ply", tmp_path / f"out{suffix}")
    refused(rf"out\{suffix}: is not a PLY, ", read_scene, path)


@pytest.mark.parametrize("suffix", [suffix for suffix in WRITERS if suffix != ".glb"])
@pytest.mark.parametrize("antialiased", [False, True])
def test_it_reads_our_files(scene, suffix, antialiased, tmp_path):
    """It decodes the same numbers as our reader, and the mark; GLB it only writes.

    It ignores the axes that an SPZ file states, so its PLY has them.
    """
    scene = replace(scene, antialiased=antialiased)
    path, writer = tmp_path / f"ours{suffix}", WRITERS[suffix]
    writer.write(path, prepared(scene, writer)[0])
    ours, theirs = read_scene(path), read_scene(transform(path, tmp_path / "back.ply"))
    if suffix == ".spz":
        theirs = turned(theirs, "RUB")
    assert theirs.antialiased == antialiased
    found = losses(ours, theirs)
    assert all(error["largest"] < 2e-4 for error in found.values()), found
