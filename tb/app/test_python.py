"""`import splatcore`: documented names, array types and shapes, results as by the commands."""

import inspect
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import splatcore
from splatcore import InputError
from splatcore.sim.frame.picture import read_png
from tb.helpers.clouds import cloud
from tb.helpers.command import ROOT, load, run

PAGE = ROOT / "docs" / "python.md"

ROOMS = {"spec", "model", "golden", "hdl", "sim", "eda", "study", "app"}

SIZE = 64, 48


def arrays(count: int = 40) -> dict[str, np.ndarray]:
    """A scene's arrays as float32, typical of training code."""
    scene = cloud(3, count)
    names = ("position", "scale", "quaternion", "opacity", "sh")
    return {name: getattr(scene, name).astype(np.float32) for name in names}


@pytest.fixture(scope="module")
def camera() -> splatcore.Camera:
    return splatcore.look_at([0.3, -0.4, -3], [0, 0, 0], *SIZE)


@pytest.fixture(scope="module")
def model(camera):
    return splatcore.pack(splatcore.make_scene(**arrays()), "faithful")[0]


def row(name: str) -> str:
    """A name's row in the page's table: its signature, and the first line of its docstring."""
    found = getattr(splatcore, name)
    call = ""
    if inspect.isfunction(found):
        parameters = inspect.signature(found).parameters.values()
        call = f"({', '.join(str(p.replace(annotation=p.empty)) for p in parameters)})"
        call = call.replace(str(splatcore.Config()), "DEFAULT")
    return f"| `{name}{call}` | {inspect.getdoc(found).splitlines()[0]} |"


def test_page_lists_all_names():
    """docs/python.md lists every public name with its signature and its docstring's first line."""
    lines = [line for line in PAGE.read_text().splitlines() if line.startswith("| `")]
    assert lines == [row(name) for name in splatcore.__all__]


def test_documented():
    """Each function's docstring has several lines and names its errors; no name hides a room."""
    assert not ROOMS & set(splatcore.__all__)
    for name in splatcore.__all__:
        text = inspect.getdoc(getattr(splatcore, name))
        if inspect.isfunction(getattr(splatcore, name)):
            assert len(text.splitlines()) > 3 and ("InputError" in text or "Errors" in text), name
    assert set(splatcore.__all__) <= set(dir(splatcore))
    with pytest.raises(AttributeError, match="'nothing'"):
        _ = splatcore.nothing


def test_import_loads_nothing():
    """`import splatcore` does not import numpy; importing the commands does not import numba."""
    for code, absent in (
        ("import splatcore", ("numpy", "splatcore.spec", "splatcore.sim")),
        ("import splatcore.app.cli.main", ("numba", "amaranth", "splatcore.golden")),
    ):
        text = f"import sys; {code}; print(sorted(set({absent}) & set(sys.modules)))"
        done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
        assert done.stdout == "[]\n", done


def test_shapes(model, camera):
    exact = splatcore.render_reference(model, camera, (0.25, 0, 1))
    picture = splatcore.render_golden(model, camera, background=(0.25, 0, 1))
    assert exact.dtype == np.float64 and picture.dtype == np.uint8
    assert exact.shape == picture.shape == (48, 64, 3)
    found = splatcore.compare(picture, exact)
    assert found.psnr_db > 50 and 0 < found.max_error < 0.05 and found.ssim > 0.99
    assert splatcore.compare(picture, picture).identical
    assert splatcore.compare(picture, picture / 255).identical
    assert splatcore.compare(exact + 2, np.ones_like(exact)).psnr_db is None
    assert splatcore.compare(picture, exact[..., ::-1]).psnr_db < 40


def test_alpha(camera, tmp_path):
    """With `rgba`, over a background, the pictures are those rendered with it; PNG keeps alpha."""
    machine = splatcore.preset("DEFAULT", rgba=True)
    model = splatcore.pack(splatcore.make_scene(**arrays()), "compact", config=machine)[0]
    exact = splatcore.render_reference(model, camera, rgba=True)
    over = exact[..., :3] + (1 - exact[..., 3:]) * (0.25, 0, 1)
    assert np.allclose(over, splatcore.render_reference(model, camera, (0.25, 0, 1)), atol=1e-12)
    picture = splatcore.render_golden(model, camera, machine, rgba=True)
    assert picture.shape == (48, 64, 4) and len(np.unique(picture[..., 3])) > 9
    assert np.abs(picture / 255 - np.clip(exact, 0, 1)).max() < 0.02
    splatcore.write(tmp_path / "p.png", picture)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "p.png"))[..., 3], picture[..., 3])


def test_one_gaussian():
    """One Gaussian has the colour, place and extent that its arrays state."""
    turned = [np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)]  # x axis to y axis
    scene = splatcore.make_scene(
        [[0, 0, 0]], [[0.5, 0.05, 0.05]], [turned], [1], colour=[[0.3, 0.4, 0.5]]
    )
    seen = splatcore.look_at([0, 0, -3], [0, 0, 0], 65, 49, fov=2 * np.degrees(np.arctan(0.5)))
    assert seen.fx == seen.fy == pytest.approx(65) and seen.cx == 32.5
    picture = splatcore.render_reference(scene, seen)
    np.testing.assert_allclose(picture[24, 32], 0.99 * np.array([0.3, 0.4, 0.5]), rtol=1e-9)
    assert picture[12, 32].max() > 0.1 and picture[24, 20].max() == 0
    assert splatcore.look_at([0, 0, -3], [0, -1, -3 + 1], 64, 48).rotation[2][1] < 0


def test_arrays_are_copied(camera):
    given = {name: array.astype(np.float64) for name, array in arrays().items()}
    kept = {name: array.copy() for name, array in given.items()}
    scene = splatcore.make_scene(**given)
    before = splatcore.render_reference(scene, camera)
    model, report = splatcore.pack(scene, cameras=[camera])
    splatcore.render_golden(model, camera)
    splatcore.cycles(model, camera)
    for name, array in kept.items():
        assert np.array_equal(given[name], array), name
    given["position"][:] = 9
    assert np.array_equal(splatcore.render_reference(scene, camera), before)
    assert report.gaussians == 40 and len(model) + report.transparent == 40


def test_no_hidden_state(model, camera):
    """A call returns the same, whatever calls come in between."""
    first = splatcore.render_golden(model, camera), splatcore.cycles(model, camera)
    slower = splatcore.cycles(model, camera, splatcore.preset(rasterizers=2))
    splatcore.render_golden(model, camera, background=(1, 1, 1))
    again = splatcore.render_golden(model, camera), splatcore.cycles(model, camera)
    assert np.array_equal(first[0], again[0]) and first[1] == again[1]
    assert slower["raster"] > first[1]["raster"] and slower["sort"] == first[1]["sort"]


BAD = {
    "position": [("nan", "position: 1 of 120 values are NaN or infinite"),
                 (np.zeros((3, 2)), r"position: has shape \(3, 2\), not \(N, 3\)"),
                 ("text", "position: is not an array")],
    "scale": [("nan", "scale: "), (np.zeros((7, 3)), r"not \(40, 3\)"),
              (np.full((40, 3), -1), "scale: -1 is not in 0")],
    "quaternion": [("nan", "quaternion: "), (np.ones((40, 3)), r"not \(40, 4\)")],
    "opacity": [("nan", "opacity: "), (np.ones((40, 1)), r"not \(40\)"),
                (np.full(40, 1.5), "opacity: 1.5 is not in 0 … 1")],
    "sh": [("nan", "sh: "), (np.ones((40, 3)), r"not \(40, N, 3\)"),
           (np.ones((40, 5, 3)), "sh: has 5 harmonics"), (None, "exactly one of sh and colour")],
}  # fmt: skip


@pytest.mark.parametrize("field", BAD)
def test_bad_arrays(field):
    for value, message in BAD[field]:
        given = arrays()
        if isinstance(value, str) and value == "nan":
            given[field].flat[3] = np.nan
        else:
            given[field] = value
        with pytest.raises(InputError, match=message):
            splatcore.make_scene(**given)


def test_other_bad_input(model, camera, tmp_path):
    scene = splatcore.make_scene(**arrays())
    mirrored = splatcore.Camera(*SIZE, 60.0, 60.0, 32, 24, np.diag([1, 1, -1]), np.zeros(3))
    half = splatcore.Camera(64.5, 48, 60.0, 60.0, 32, 24, np.eye(3), np.zeros(3))
    large = splatcore.look_at([0, 0, -3], [0, 0, 0], 2048, 48)
    with_array = splatcore.pack(scene, "compact", config="PAPER")[0]
    for call, message in (
        (lambda: splatcore.render_golden(scene, camera), "model: is a Scene; pack it first"),
        (lambda: splatcore.render_golden(model, mirrored), "rotation is not a rotation matrix"),
        (lambda: splatcore.render_reference(scene, half), "camera: width: is of type float"),
        (lambda: splatcore.render_golden(model, large), "2048x48: preset DEFAULT renders up to"),
        (lambda: splatcore.cycles(with_array, camera), "preset DEFAULT 'chunk'"),
        (lambda: splatcore.cycles(model, camera, "nope"), "preset 'nope': unknown"),
        (lambda: splatcore.render_golden(model, camera, background=(0, 2, 0)), "background: 2 is"),
        (lambda: splatcore.render_golden(model, camera, rgba=True), "rgba is false"),
        (lambda: splatcore.render_reference(scene, camera, (1, 0, 0), True), "background: is not"),
        (lambda: splatcore.pack(scene, "best"), "quality: 'best' is not one of small"),
        (lambda: splatcore.pack(model), "scene: is of type PackedModel"),
        (lambda: splatcore.look_at([0, 0, 0], [0, 0, 0]), "target: is the camera's position"),
        (lambda: splatcore.look_at([0, 0, 0], [0, 2, 0]), "down: is parallel"),
        (lambda: splatcore.look_at([0, 0, 0], [0, 0, 1], 0), "width: 0 is not in 1"),
        (lambda: splatcore.open_scene("nope.ply"), "nope.ply: "),
        (lambda: splatcore.open_cameras("nope.json"), "nope.json: "),
        (lambda: splatcore.pack(scene, cameras=camera), "cameras: is of type Camera, not a list"),
        (lambda: splatcore.pack(scene, cameras=[5]), "camera: is of type int, not Camera"),
        (lambda: splatcore.open_cameras(scene, 64), "both width and height"),
        (lambda: splatcore.open_cameras(scene, near="0.1"), "near: is of type str, not"),
        (lambda: splatcore.open_cameras(scene, near=None), "near: is of type NoneType"),
        (lambda: splatcore.open_cameras(scene, near=0), "near 0 is not in"),
        (lambda: splatcore.compare(np.zeros((4, 4)), np.zeros((4, 4))), "image: has shape"),
        (lambda: splatcore.compare(np.zeros((4, 4, 3)), np.zeros((4, 5, 3))), "image: .*, truth"),
        (lambda: splatcore.compare(np.zeros((4, 4, 3), int), np.zeros((4, 4, 3))), "type int64"),
        (lambda: splatcore.preset(rasteriser=2), "did you mean 'rasterizers'"),
        (lambda: splatcore.preset(pes="9"), "pes: '9' is not an integer"),
        (lambda: splatcore.preset(pes=99), "pes 99 is not in 1 … 16"),
        (lambda: splatcore.preset(burst=16, page=8), "burst 16 is above 8"),
        (lambda: splatcore.write(tmp_path / "a.jpg", np.zeros((4, 4, 3))), "must end in .png"),
        (lambda: splatcore.write(tmp_path / "no" / "a.png", np.zeros((4, 4, 3))), "does not exist"),
        (lambda: splatcore.write(tmp_path / "a.png", [1]), "thing: is of type list"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=message) as error:
            call()
        assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


def test_antialiased(model, tmp_path):
    """Files and models keep the mark; the argument `antialiased` overrides a file's mark."""
    marked = splatcore.make_scene(**arrays(), antialiased=True)
    assert marked.antialiased and not splatcore.make_scene(**arrays()).antialiased
    assert splatcore.pack(marked, "faithful")[0].antialiased and not model.antialiased
    splatcore.write(tmp_path / "a.ply", marked)
    splatcore.write(tmp_path / "a.splatcore", model)
    for override, mark in {
        None: "PLY comment 'SplatRenderMode: mip'",
        True: "antialiased=True",
        False: "antialiased=False",
    }.items():
        found = splatcore.open_scene(tmp_path / "a.ply", antialiased=override)
        assert found.antialiased == (override is not False) and found.mark == mark
    assert splatcore.open_scene("garden", antialiased=True).antialiased
    for call, message in (
        (lambda: splatcore.open_scene("garden", antialiased=1), "antialiased: is of type int"),
        (lambda: splatcore.make_scene(**arrays(), antialiased="no"), "antialiased: is of type str"),
        (
            lambda: splatcore.open_scene(tmp_path / "a.splatcore", True),
            "a packed model has its own",
        ),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_preset():
    own = splatcore.preset("tiny", rasterizers=np.int64(4), sort_digits=(3, 4, 4, 4), faint=[])
    assert (own.rasterizers, own.sort_digits, own.faint) == (4, (3, 4, 4, 4), ())
    assert own.width_max == 64 and own.name == "own"
    assert splatcore.preset() == splatcore.Config()
    assert splatcore.preset("PAPER").arithmetic == splatcore.preset("PAPER", pes=6).arithmetic


def test_files(model, camera, tmp_path):
    """Written files read back the same; `write` refuses to overwrite a scene's own file."""
    scene = splatcore.make_scene(**arrays())
    splatcore.write(tmp_path / "s.ply", scene)
    splatcore.write(tmp_path / "m.splatcore", model)
    picture = splatcore.render_golden(model, camera)
    splatcore.write(tmp_path / "p.png", picture)
    again = splatcore.open_scene(tmp_path / "s.ply")
    np.testing.assert_allclose(again.position, scene.position, rtol=1e-6)
    back = splatcore.open_scene(tmp_path / "m.splatcore")
    assert np.array_equal(back.image, model.image)
    assert np.array_equal(read_png(tmp_path / "p.png"), picture)
    large = splatcore.pack(splatcore.make_scene(**arrays(300)), "faithful")[0]
    for name, plain in (("coded", False), ("plain", True)):
        path = tmp_path / f"{name}.splatcore"
        splatcore.write(path, large, plain=plain)
        assert (path.read_bytes() == large.image.tobytes()) == plain
        assert np.array_equal(splatcore.open_scene(path).image, large.image)
    with pytest.raises(InputError, match="plain: is for packed models"):
        splatcore.write(tmp_path / "q.png", picture, plain=True)
    with pytest.raises(InputError, match=r"s\.ply: write would overwrite"):
        splatcore.write(tmp_path / "s.ply", again)
    with pytest.raises(InputError, match=r"m\.splatcore: write would overwrite"):
        splatcore.write(tmp_path / "m.splatcore", back)


def test_cameras(tmp_path):
    """`open_cameras`: a scene's camera file, a generated scene's camera, or a default view."""
    scene = splatcore.make_scene(**arrays())
    splatcore.write(tmp_path / "scene.ply", scene)
    for given in (scene, tmp_path / "scene.ply", str(tmp_path / "scene.ply")):
        [view] = splatcore.open_cameras(given)
        assert (view.width, view.height) == (1920, 1080)
    assert run("scene", "garden", "--count", 100, "-o", tmp_path / "g.ply",
               "--cameras", tmp_path / "g.cameras.json") == 0  # fmt: skip
    [own] = splatcore.open_cameras(tmp_path / "g.ply", 32, 18)
    [named] = splatcore.open_cameras("garden", 32, 18)
    [of_file] = splatcore.open_cameras(tmp_path / "g.cameras.json", 32, 18)
    for other in (named, of_file):
        assert (own.width, own.height) == (other.width, other.height) == (32, 18)
        np.testing.assert_allclose(own.position, other.position, atol=1e-6)


def test_same_as_the_commands(tmp_path):
    """Picture and cycles are the same as by `render --engine golden` and `cycles --json`."""
    scene = splatcore.open_scene("needles")
    [camera] = splatcore.open_cameras("needles", 128, 72)
    model, _ = splatcore.pack(scene, cameras=[camera])
    assert run("render", "needles", "--engine", "golden", "--size", "128x72", "--no-compare",
               "--background", "0.5,0,1", "-o", tmp_path / "a.png") == 0  # fmt: skip
    picture = splatcore.render_golden(model, camera, background=(0.5, 0, 1))
    assert np.array_equal(read_png(tmp_path / "a.png"), picture)
    file = tmp_path / "a.json"
    assert run("cycles", "needles", "--size", "128x72", "--json", file) == 0
    expected = load(file)["scenes"]["needles"]
    found = splatcore.cycles(model, camera)
    assert found == {key: expected[key] for key in found}
    assert expected["packing"]["bytes_per_gaussian"] == model.bytes_per_gaussian
    exact = splatcore.render_reference(scene, camera)
    against = splatcore.compare(splatcore.render_golden(model, camera), exact)
    assert against.psnr_db == pytest.approx(expected["psnr_db_scene"])
