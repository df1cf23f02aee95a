"""Gaussians in OpenUSD, written by usd-core itself: usda, usdc, usdz; broken and missing parts.

Tests that need usd-core are skipped without it (extra [usd]).
"""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from splatcore.model.formats import usd
from splatcore.model.formats.read import read_scene
from splatcore.model.formats.spz_axes import turned
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene
from tb.helpers.moved import check_moved, covariance, transform
from tb.helpers.refusal import refused
from tb.helpers.scene_file import check_bad_scene
from tb.helpers.scenes import REAL, random_scene, scene_path

needs_usd = pytest.mark.skipif(find_spec("pxr") is None, reason="needs usd-core")

NOTE = "the USD stage says y is up; read as RDF, as usd-convert-gsplat writes it; "
NOTE += "choose others by --axes"

SH = "radiance:sphericalHarmonicsCoefficients"

ARRAYS = {
    "f": ("Vec3fArray", "QuatfArray", "FloatArray"),
    "h": ("Vec3hArray", "QuathArray", "HalfArray"),
}
"""Types of vectors, quaternions and numbers, by the letter of their precision."""


def define(stage, path: str, scene: Scene, half: bool = False):
    """Define a prim with a scene's Gaussians; return it."""
    from pxr import Gf, Sdf, Vt

    prim = stage.DefinePrim(path, "ParticleField3DGaussianSplat")
    vector, quaternion, number = (getattr(Vt, name) for name in ARRAYS["h" if half else "f"])
    quat = Gf.Quath if half else Gf.Quatf
    turns = [quat(*map(float, row)) for row in scene.quaternion]
    arrays = {
        "positions": vector(_rows(scene.position)),
        "orientations": quaternion(turns),
        "scales": vector(_rows(scene.scale)),
        "opacities": number(scene.opacity.tolist()),
        SH: vector(_rows(scene.sh.reshape(-1, 3))),
    }
    for name, array in arrays.items():
        prim.GetAttribute(name + "h" * half).Set(array)
    degree = Sdf.ValueTypeNames.Int
    prim.CreateAttribute("radiance:sphericalHarmonicsDegree", degree).Set(scene.sh_degree)
    return prim


def _rows(values: np.ndarray) -> list[tuple[float, ...]]:
    return [tuple(row) for row in values.tolist()]


def new_stage(path: Path, up: str = "Y"):
    """A stage to be saved as usda or usdc."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    return stage


def written(path: Path, *scenes: Scene, half: bool = False) -> Path:
    """A stage with a prim per scene."""
    stage = new_stage(path)
    for k, scene in enumerate(scenes):
        define(stage, f"/g{k}", scene, half)
    stage.Save()
    return path


@needs_usd
@pytest.mark.parametrize("suffix", ("usda", "usdc", "usdz"))
def test_every_attribute(tmp_path, suffix):
    """Each form of file gives the numbers of the PLY, unturned."""
    scene, path = random_scene(30, 3), tmp_path / f"a.{suffix}"
    if suffix == "usdz":
        from pxr import UsdUtils

        inner = written(tmp_path / "inner.usdc", scene)
        assert UsdUtils.CreateNewUsdzPackage(str(inner), str(path))
    else:
        written(path, scene)
    found = read_scene(path)
    for name in ("position", "scale", "quaternion", "opacity", "sh"):
        wanted = getattr(scene, name).astype(np.float32)
        assert np.array_equal(getattr(found, name), wanted), name
    assert (found.name, found.notes) == (str(path), (NOTE,))


@needs_usd
@pytest.mark.parametrize("degree", range(3))
def test_half_floats(tmp_path, degree):
    """Twins of half floats are read if there are no floats."""
    from pxr import Vt

    scene, path = random_scene(30, degree), tmp_path / "a.usdc"
    found = read_scene(written(path, scene, half=True))
    for name in ("position", "scale", "quaternion", "opacity", "sh"):
        wanted = getattr(scene, name).astype(np.float16)
        assert np.array_equal(getattr(found, name), wanted), name
    stage = new_stage(tmp_path / "b.usda")
    prim = define(stage, "/g", scene)
    other = random_scene(30, degree, seed=1)
    prim.GetAttribute("positionsh").Set(Vt.Vec3hArray(_rows(other.position)))
    stage.Save()
    assert np.array_equal(read_scene(tmp_path / "b.usda").position, scene.position.astype("f4"))


@needs_usd
@pytest.mark.parametrize("half", (False, True))
@pytest.mark.parametrize("name", ("random", pytest.param("leica", marks=REAL)))
def test_the_schema_s_own_class(tmp_path, half, name):
    """The class of UsdVol creates the attributes that are read."""
    from pxr import Gf, Usd, UsdVol, Vt

    leica = scene_path("leica-sofort-top8192.ply")
    scene = random_scene(40, 3) if name == "random" else read_scene(leica)
    stage, h = Usd.Stage.CreateNew(str(tmp_path / "a.usdc")), "h" * half
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/scene")
    vector, quaternion, number = (getattr(Vt, kind) for kind in ARRAYS[h or "f"])
    float16 = np.float16 if half else np.float32
    quat = Gf.Quath if half else Gf.Quatf
    for made, array in (
        ("Positions", vector.FromNumpy(scene.position.astype(float16))),
        ("Orientations", quaternion([quat(*map(float, row)) for row in scene.quaternion])),
        ("Scales", vector.FromNumpy(scene.scale.astype(float16))),
        ("Opacities", number.FromNumpy(scene.opacity.astype(float16))),
        (
            "RadianceSphericalHarmonicsCoefficients",
            vector.FromNumpy(scene.sh.reshape(-1, 3).astype(float16)),
        ),
    ):
        getattr(field, f"Create{made}{h}Attr")(array)
    field.CreateRadianceSphericalHarmonicsDegreeAttr(scene.sh_degree)
    field.CreateSortingModeHintAttr("zDepth")
    stage.Save()
    found = read_scene(tmp_path / "a.usdc")
    for each in ("position", "scale", "quaternion", "opacity", "sh"):
        assert np.array_equal(getattr(found, each), getattr(scene, each).astype(float16)), each


@needs_usd
def test_transforms_and_axes(tmp_path):
    """Transforms of prims apply; then the stage's axes are turned as the caller chooses."""
    from pxr import Gf, UsdGeom

    scene, matrix = random_scene(20, 2), transform(3, 2.5)
    stage = new_stage(tmp_path / "a.usda", "Z")
    above = UsdGeom.Xform.Define(stage, "/above")
    above.AddTransformOp().Set(Gf.Matrix4d(*matrix.T.ravel().tolist()))
    define(stage, "/above/g", scene)
    define(stage, "/plain", random_scene(5, 0))
    stage.Save()
    found = read_scene(tmp_path / "a.usda")
    assert (len(found), found.sh_degree) == (25, 2)
    check_moved(found[:20], scene, matrix[:3, :3], matrix[:3, 3])
    assert found.notes == (NOTE.replace("y is up", "z is up"),)
    other, wanted = read_scene(tmp_path / "a.usda", "RBU"), turned(found, "RBU")
    assert np.array_equal(other.position, wanted.position)
    assert np.abs(covariance(other) - covariance(wanted)).max() < 1e-12
    assert other.notes == ("the USD stage says z is up; read as RBU, by --axes",)
    above.ClearXformOpOrder()
    above.AddScaleOp().Set(Gf.Vec3f(1, 2, 1))
    stage.Save()
    refused("a.usda: /above/g: transform with a scale that is not", read_scene, tmp_path / "a.usda")


@needs_usd
def test_defaults(tmp_path):
    """Missing and short attributes have the schema's defaults; hidden prims are left out."""
    from pxr import UsdGeom

    scene, path = random_scene(6, 1), tmp_path / "a.usda"
    stage = new_stage(path)
    prim = define(stage, "/g", scene)
    hidden = define(stage, "/hidden", scene)
    UsdGeom.Imageable(hidden).MakeInvisible()
    for name in ("orientations", "scales", "opacities"):
        prim.GetAttribute(name).Clear()
    prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(2)
    stage.Save()
    found = read_scene(path)
    assert np.array_equal(found.quaternion, np.tile([1, 0, 0, 0], (6, 1)))
    assert (found.scale == 1).all() and (found.opacity == 1).all() and not found.sh.any()
    short = f"'{SH}' has 24 entries, not 54: not used"
    assert found.notes == (short, NOTE, "1 hidden ParticleField3DGaussianSplat not read")
    prim.GetAttribute("positions").Clear()
    stage.Save()
    refused("a.usda: /g: 'positions' is missing", read_scene, path)
    stage.RemovePrim("/g")
    stage.Save()
    refused("that is visible, and 1 hidden", read_scene, path)


@needs_usd
def test_time_samples(tmp_path):
    """The first time of an animated stage is read."""
    scene, path = random_scene(4, 0), tmp_path / "a.usda"
    stage = new_stage(path)
    attribute = define(stage, "/g", scene).GetAttribute("positions")
    first, last = attribute.Get(), attribute.Get()
    last[0] = (7, 7, 7)
    attribute.Clear()
    for time, value in ((5, last), (2, first)):
        attribute.Set(value, time)
    stage.Save()
    assert np.array_equal(read_scene(path).position, scene.position.astype(np.float32))


@needs_usd
def test_bad_files(tmp_path):
    crate = written(tmp_path / "whole.usdc", random_scene(9, 1)).read_bytes()
    text = written(tmp_path / "whole.usda", random_scene(9, 1)).read_text()
    for suffix, data, message in (
        ("usdc", crate[:900], "usd-core cannot read it (Sdf crate file corrupt"),
        ("usdc", crate[:-100], "usd-core cannot read it (Encountered: Read out-of-bounds"),
        ("usdc", b"PXR-USDC" + bytes(8) + crate[16:], "usd-core cannot read it ("),
        ("usda", text[:600].encode(), "usd-core cannot read it (line "),
        ("usda", b"#usda 1.0\n", "holds no ParticleField3DGaussianSplat"),
        ("usdz", b"PK\x03\x04 no zip", "usd-core cannot read it (Failed to open layer)"),
        ("usda", text.replace("Degree = 1", "Degree = -1").encode(), "/g0: SH degree -1"),
        ("usda", text.replace("quatf[]", "float[]").encode(), "usd-core cannot read it"),
    ):
        check_bad_scene(tmp_path / f"a.{suffix}", data, message)


@needs_usd
def test_child_process_is_bounded(tmp_path, monkeypatch):
    """A child process that runs out of memory or time ends in one line."""
    path = written(tmp_path / "a.usdc", random_scene(9, 1))
    monkeypatch.setattr(usd, "MEMORY", 400 << 20)
    refused("a.usdc: usd-core cannot read it", read_scene, path)
    monkeypatch.undo()
    monkeypatch.setattr(usd, "SECONDS", 0.01)
    refused("a.usdc: usd-core takes more than 0.01 seconds", read_scene, path)


@needs_usd
@pytest.mark.slow
@pytest.mark.parametrize("suffix", ("usda", "usdc"))
def test_mutated(tmp_path, suffix):
    """Files with flipped bits, extreme bytes or a missing end are read or refused in one line."""
    path = tmp_path / f"a.{suffix}"
    data = np.frombuffer(written(path, random_scene(6, 1)).read_bytes(), np.uint8)
    rng, outcomes = np.random.default_rng(0), set()
    for _ in range(12):
        changed, at = data.copy(), rng.integers(8, len(data), 3)
        changed[at[0]] ^= 1 << rng.integers(8)
        changed[at[1] : at[1] + 8] = rng.choice([0, 127, 255])
        path.unlink()
        path.write_bytes(changed[: at[2] if rng.random() < 0.2 else None].tobytes())
        try:
            outcomes.add(read_scene(path).sh_degree)
        except InputError as error:
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
            outcomes.add("refused")
    assert "refused" in outcomes


def test_without_usd_core(tmp_path, monkeypatch):
    (tmp_path / "a.usda").write_text("#usda 1.0\n")
    monkeypatch.setattr(usd, "find_spec", lambda name: None)
    message = "USD needs usd-core: pip install 'splatcore[usd]'"
    check_bad_scene(tmp_path / "a.usda", b"#usda 1.0\n", message)
