"""Any scene written in any format is read back within the format's stated loss: extreme and equal
numbers included."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from splatcore.model.export.loss import angles
from splatcore.model.export.spz import fraction_bits
from splatcore.model.export.writers import WRITERS, prepared
from splatcore.model.formats.ply import SCALE_MIN, write_compressed_ply
from splatcore.model.formats.read import read_scene
from splatcore.spec.scene import Scene
from tb.helpers.refusal import refused
from tb.helpers.scenes import random_scene

repeatable = settings(deadline=None, derandomize=True, database=None)

WILD = {"scale", "opacity", "quaternion", "position", "sh", "equal"}


@st.composite
def scenes(draw) -> Scene:
    """Some numbers are extreme: of the fields drawn, in a share of the Gaussians."""
    count, degree = draw(st.sampled_from([1, 255, 256, 257])), draw(st.integers(0, 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    scene, wild = (
        random_scene(count, degree, int(rng.integers(1000))),
        draw(st.sets(st.sampled_from(sorted(WILD)))),
    )

    def some(*shape: int) -> np.ndarray:
        return rng.random((count, *shape)) < 0.2

    def power(mask: np.ndarray, low: float, high: float) -> np.ndarray:
        return 10.0 ** rng.uniform(low, high, mask.sum())

    if "scale" in wild:
        for mask, low, high in ((some(3), -60, -10), (some(3), 2, 37)):
            scene.scale[mask] = power(mask, low, high)
        scene.scale[some(3)] = 0
    if "opacity" in wild:
        scene.opacity[some()], scene.opacity[some()], scene.opacity[some()] = 0, 1, 1e-30
    if "quaternion" in wild:
        mask = some()
        scene.quaternion[mask] *= power(mask, -30, 30)[:, None]
        scene.quaternion[some()] = 0
    if "position" in wild:
        for mask, low, high in ((some(3), -60, -10), (some(3), 1, 6)):
            scene.position[mask] *= power(mask, low, high)
    if "sh" in wild:
        mask = some(*scene.sh.shape[1:])
        scene.sh[mask] *= power(mask, -30, 2)
    if "equal" in wild:
        scene = scene[np.zeros(count, int)]
    return replace(scene, antialiased=bool(rng.integers(2)))


def steps(values: np.ndarray, bits: tuple[int, ...]) -> np.ndarray:
    """The step of each column [N, 3] with numbers of `bits` between the extremes of 256 rows."""
    found = np.empty(values.shape)
    for start in range(0, len(values), 256):
        part = values[start : start + 256]
        found[start : start + 256] = np.ptp(part, axis=0) / (2.0 ** np.array(bits) - 1)
    return found


def bounds(suffix: str, scene: Scene) -> dict[str, tuple[np.ndarray, np.ndarray | float]]:
    """The numbers that a file stores for each field, and the largest error beyond float32."""
    logs = np.log(np.maximum(scene.scale, SCALE_MIN))
    found = {
        "position": (scene.position, 0),
        "log scale": (logs, 0),
        "opacity": (scene.opacity, 1e-7),
        "colour": (scene.sh[:, 0], 0),
        "harmonics": (scene.sh[:, 1:], 0),
        "rotation": (0 * scene.opacity, 1e-6),
    }
    byte = 0.5 / 255
    match suffix:
        case ".compressed.ply":
            found["position"] = scene.position, steps(scene.position, (11, 10, 11)) / 2
            found["log scale"] = (
                np.clip(logs, -20, 20),
                steps(np.clip(logs, -20, 20), (11, 10, 11)) / 2,
            )
            found["colour"] = scene.sh[:, 0], steps(scene.sh[:, 0], (8, 8, 8)) / 2
            each = np.clip(scene.sh[:, 1:], -4, 4)
            found["harmonics"] = each, np.where(np.abs(each) > 3.96, 1 / 32, 1 / 64)
            found["rotation"] = 0 * scene.opacity, 0.006
        case ".spz":
            found["position"] = scene.position, 2.0 ** -(fraction_bits(scene.position, "") + 1)
            found["log scale"] = np.clip(logs, -10, 255 / 16 - 10), 1 / 32
            found["colour"] = np.clip(scene.sh[:, 0], -0.5 / 0.15, 0.5 / 0.15), byte / 0.15
            found["harmonics"] = np.clip(scene.sh[:, 1:], -1, 1), 1 / 128  # 1 is 127/128
            found["rotation"] = 0 * scene.opacity, 0.006
        case ".sog":
            logarithm = np.log1p(np.abs(scene.position))
            step = np.ptp(np.sign(scene.position) * logarithm, axis=0) / 65535
            found["position"] = scene.position, np.exp(logarithm) * step + 1e-12
            for name in ("log scale", "colour", "harmonics"):
                values = found[name][0]
                found[name] = values, np.ptp(values) / 50 if values.size else 0
            found["rotation"] = 0 * scene.opacity, 0.03
    if suffix in (".compressed.ply", ".spz", ".sog"):
        found["opacity"] = scene.opacity, byte
    return found


def check(suffix: str, scene: Scene) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path, writer = Path(folder) / f"scene{suffix}", WRITERS[suffix]
        scene, note = prepared(scene, writer)
        assert not note
        writer.write(path, scene)
        stored = read_scene(path)
    assert len(stored) == len(scene) and stored.antialiased == scene.antialiased
    fields = {
        "position": stored.position,
        "log scale": np.log(np.maximum(stored.scale, SCALE_MIN)),
        "opacity": stored.opacity,
        "colour": stored.sh[:, 0],
        "harmonics": stored.sh[:, 1:],
        "rotation": angles(stored.quaternion, scene.quaternion),
    }
    for name, (wanted, bound) in bounds(suffix, scene).items():
        float32 = 2e-6 * np.abs(wanted) + (1e-6 if name != "position" else 1e-38)
        excess = np.abs(fields[name] - wanted) - bound - float32
        assert (excess <= 0).all(), (name, excess.max())


@pytest.mark.parametrize("suffix", [suffix for suffix in WRITERS if suffix != ".sog"])
@settings(repeatable, max_examples=25)
@given(scene=scenes())
def test_any_scene(suffix, scene):
    check(suffix, scene)


@settings(repeatable, max_examples=6)  # its codebooks take a second
@given(scene=scenes())
def test_any_scene_as_sog(scene):
    check(".sog", scene)


@pytest.mark.parametrize("suffix", WRITERS)
def test_nothing_to_write(suffix):
    refused(
        "a.ply: holds no Gaussian",
        prepared,
        replace(random_scene(0, 1), name="a.ply"),
        WRITERS[suffix],
    )


@pytest.mark.filterwarnings("error")
def test_bounds_of_compressed_ply_fit_in_float32(tmp_path):
    scene = random_scene(300, 0)
    scene.position[7], scene.position[9] = -3e38, 3e38
    refused(
        "a.ply: positions 6e.38 apart are too far", write_compressed_ply, tmp_path / "a.ply", scene
    )
    assert not any(tmp_path.iterdir())
