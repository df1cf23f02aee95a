"""`splatcore hard`: every case meets its bound, and planted failures are reported."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from splatcore.app.cli import hard as hard_command
from splatcore.golden.pipeline import render
from splatcore.golden.reference import render as render_reference
from splatcore.model.generate.hard import HARD
from splatcore.model.generate.hard_case import PSNR_MIN
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.choose import finest
from splatcore.sim.frame.metric import psnr
from splatcore.sim.frame.picture import read_png
from splatcore.sim.machine import path
from splatcore.spec.config import TINY
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.study.bench import hard_cases
from tb.helpers.bounds import BOUND, RULE
from tb.helpers.command import check_documented, load, run

QUICK = ("opacity_edge", "empty", "one", "one_pixel")  # each takes less than 0.1 seconds


def measured(path, *arguments: str, status: int = 0) -> dict:
    """Run `splatcore hard ARGUMENTS --preset tiny` and return its JSON."""
    file = path / "hard.json"
    assert run("hard", *arguments, "--preset", "tiny", "--json", file) == status
    return load(file)


@pytest.fixture
def quick(monkeypatch):
    """Restrict the command to the quick cases."""
    monkeypatch.setattr(hard_command, "HARD", {name: HARD[name] for name in QUICK})


def check_keys(facts: dict):
    """Check that docs/json.md documents every key."""
    case = next(iter(facts["cases"].values()))
    keys = (*facts, *case, *case["left_out"])
    check_documented("## `splatcore hard`", keys)


@pytest.mark.slow
def test_all_cases_of_the_golden_model(tmp_path, capsys):
    folder = tmp_path / "pictures"
    facts = measured(tmp_path, "-o", str(folder))
    check_keys(facts)
    assert facts["passed"] and facts["engine"] == "golden" and facts["timing"] is None
    cases = facts["cases"]
    assert list(cases) == list(HARD)
    assert all(case["passed"] and case["cycles"] > 0 for case in cases.values())
    assert {name for name, case in cases.items() if case["psnr_db_machine"] is None} == {"empty"}
    assert cases["empty"]["reason"] == "an empty scene: identical pictures"
    assert cases["not_finite"]["left_out"]["not_finite"] == 15
    assert cases["opacity_edge"]["left_out"]["transparent"] == 64
    assert cases["near_plane"]["left_out"]["near_culled"] > 0
    assert cases["one_pixel"]["ssim_machine"] is None
    assert {path.stem for path in folder.glob("*.png")} == {*HARD, "hard-cases"}
    assert read_png(folder / "hard-cases.png").std() > 20
    text = capsys.readouterr().out
    assert text.count(": pass (") == len(HARD) and "34 of 34 pass" in text and "FAIL" not in text
    (empty,) = re.findall(r"^ +empty .*", text, re.M)
    assert empty.split()[1:3] == ["identical", "identical"], "of both PSNR, machine"


def test_measured_values(tmp_path, capsys):
    """PSNR, largest error, cycles and picture equal the ones computed here from the models."""
    assert PSNR_MIN == BOUND
    case = measured(tmp_path, "one", "-o", str(tmp_path))["cases"]["one"]
    hard = HARD["one"](0)
    model, _ = pack(hard.scene, TINY)
    golden = render(TINY, model, hard.camera)
    exact = render_reference(model.gaussians(), hard.camera)
    error = golden.pixels / 255 - np.clip(exact.image, 0, 1)
    assert case["psnr_db_machine"] == pytest.approx(-10 * np.log10(np.mean(error**2)))
    worst = np.abs(golden.pixels.astype(int) - exact.pixels.astype(int)).max()
    assert case["max_error_machine"] == pytest.approx(worst / 255)
    assert case["cycles"] == frame_cycles(TINY, golden).frame
    np.testing.assert_array_equal(read_png(tmp_path / "one.png"), golden.pixels)
    whole = render_reference(hard.scene.gaussians(), hard.camera).pixels / 255
    assert case["psnr_db_scene"] == pytest.approx(psnr(golden.pixels / 255, whole))
    assert case["psnr_db_packing"] == pytest.approx(psnr(exact.pixels / 255, whole))
    line = f"one: pass (machine, own rule ≥ 52 dB): {case['psnr_db_rule']:.2f} dB"
    assert line in capsys.readouterr().out


def test_faint_splats(tmp_path):
    """Faint splats that the machine drops do not fail the case: the bound uses its own rule."""
    case = measured(tmp_path, "fog")["cases"]["fog"]
    hard = HARD["fog"](0)
    model, _ = pack(hard.scene, TINY, quality=finest(hard.scene, TINY))
    exact = [render_reference(model.gaussians(), hard.camera, r).image for r in (SPLATCORE, RULE)]
    pixels = render(TINY, model, hard.camera).pixels / 255
    found = [psnr(pixels, image.clip(0, 1)) for image in exact]
    assert [case["psnr_db_machine"], case["psnr_db_rule"]] == pytest.approx(found)
    assert case["passed"] and found[0] < PSNR_MIN < found[1]


def test_reference(tmp_path, quick, capsys):
    facts = measured(tmp_path, "--engine", "reference", "-o", str(tmp_path / "pictures"))
    assert facts["passed"] and list(facts["cases"]) == list(QUICK)
    one = facts["cases"]["one"]
    assert one["psnr_db_machine"] is None and one["cycles"] is None and one["psnr_db_packing"] > 50
    assert facts["cases"]["opacity_edge"]["left_out"]["unseen"] == 64
    hard = HARD["one"](0)
    expected = render_reference(hard.scene.gaussians(), hard.camera).pixels
    np.testing.assert_array_equal(read_png(tmp_path / "pictures" / "one.png"), expected)
    assert "the reference itself" in capsys.readouterr().out


def test_nan_in_the_reference(tmp_path):
    facts = measured(tmp_path, "not_finite", "--engine", "reference")
    assert facts["cases"]["not_finite"]["left_out"]["not_finite"] == 15


def test_size(tmp_path):
    case = measured(tmp_path, "one", "--size", "20x10", "-o", str(tmp_path))["cases"]["one"]
    assert case["size"] == [20, 10] and case["passed"] and case["ssim_machine"] is None
    assert read_png(tmp_path / "one.png").shape == (10, 20, 3)


def changed(golden, place: tuple[int, int, int], by: int):
    """Return a golden frame with one colour value XORed."""
    pixels = golden.pixels.copy()
    pixels[place] ^= by
    return replace(golden, raster=golden.raster._replace(pixels=pixels))


def test_a_wrong_picture(tmp_path, monkeypatch, quick, capsys):
    """A wrong pixel fails every case that has it; the command still runs all cases."""

    def wrong(config, model, camera):
        golden = render(config, model, camera)
        return changed(golden, (20, 30, 1), 128) if camera.height > 20 else golden

    monkeypatch.setattr(hard_cases.pipeline, "render", wrong)
    facts = measured(tmp_path, "-o", str(tmp_path), status=1)
    assert not facts["passed"]
    failed = [name for name, case in facts["cases"].items() if not case["passed"]]
    assert failed == ["opacity_edge", "empty", "one"]
    text = capsys.readouterr().out
    assert re.search(
        r"one: FAIL \(machine, own rule ≥ 52 dB\): 4\d\.\d\d dB against the reference with its "
        r"own rule, below 52 dB",
        text,
    )
    assert "1 of 4 pass; not: opacity_edge, empty, one\n" in text


def test_wrong_about_nan(tmp_path, monkeypatch, capsys):
    """A wrong count of NaN Gaussians fails, and so does a reference pixel that is not finite."""

    def careless(scene, config, quality):
        model, report = pack(scene, config, quality=quality)
        return model, replace(report, not_finite=1)

    monkeypatch.setattr(hard_cases, "pack", careless)
    measured(tmp_path, "one", status=1)
    assert "1 Gaussian dropped for NaN or Inf, but 0 have one" in capsys.readouterr().out

    def infinite(*arguments):
        frame = render_reference(*arguments)
        frame.image[3, 4] = np.inf
        return frame

    monkeypatch.setattr(hard_cases, "render", infinite)
    facts = measured(tmp_path, "one", "--engine", "reference", status=1)
    assert facts["cases"]["one"]["failures"] == ["a pixel is not finite"]


def test_packing_below_its_bound(tmp_path, monkeypatch, capsys):
    """Packing below its bound fails with every engine; a met bound is reported, too."""
    facts = measured(tmp_path, "zero_bands")["cases"]["zero_bands"]
    assert (
        facts["bound"] == "machine, own rule ≥ 52 dB; packing ≥ 50 dB"
        and facts["psnr_db_packing"] >= 50
    )
    monkeypatch.setattr(hard_cases, "finest", lambda *_: "balanced")
    for engine in ("reference", "golden"):
        measured(tmp_path, "zero_bands", "--engine", engine, status=1)
        assert "packing: 35.76 dB, below 50 dB" in capsys.readouterr().out
    monkeypatch.undo()
    assert run("hard zero_bands --engine reference --preset paper") == 0  # no steps, no bound
    assert "packing ≥" not in capsys.readouterr().out


def test_packing_that_fails(tmp_path, monkeypatch, quick):
    """A case that cannot be packed fails with its reason; the other cases still run."""

    def refuse(scene, config, quality):
        if len(scene) == 1:
            raise InputError("a position is too large")
        return pack(scene, config, quality=quality)

    monkeypatch.setattr(hard_cases, "pack", refuse)
    cases = measured(tmp_path, "-o", str(tmp_path / "pictures"), status=1)["cases"]
    assert cases["one"]["failures"] == ["a position is too large"] and cases["empty"]["passed"]
    found = {path.stem for path in (tmp_path / "pictures").iterdir()}
    assert found == {*QUICK, "hard-cases"} - {"one"}


def test_a_machine_that_hangs(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(path, "build", lambda config: SimpleNamespace(config=config))
    monkeypatch.setattr(
        hard_cases, "simulate", lambda *_: SimpleNamespace(done=False, why="stands still")
    )
    case = measured(tmp_path, "one", "--engine", "rtl", status=1)["cases"]["one"]
    assert case["identical"] is False and case["cycles"] is None
    assert (
        "one: FAIL (golden's, machine, own rule ≥ 52 dB): the machine failed: stands"
        in capsys.readouterr().out
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["empty", "one", "near_plane", "not_finite", "one_pixel"])
def test_hardware(name, tmp_path):
    """RTL gives the golden model's picture, and its counters drop the same Gaussians."""
    golden = measured(tmp_path, name, "-o", str(tmp_path))["cases"][name]
    picture = read_png(tmp_path / f"{name}.png")
    facts = measured(tmp_path, name, "--engine", "rtl", "-o", str(tmp_path))
    check_keys(facts)
    case = facts["cases"][name]
    assert facts["timing"] == "lpddr4" and case["passed"] and case["identical"]
    np.testing.assert_array_equal(read_png(tmp_path / f"{name}.png"), picture)
    for key in (
        "psnr_db_machine",
        "ssim_machine",
        "max_error_machine",
        "left_out",
        "psnr_db_packing",
        "reason",
    ):
        assert case[key] == golden[key], key
    # The cycle model includes memory latency; for frames as small as these it is up to 4.4 %
    # above the hardware (not_finite: 18,729 instead of 17,943 cycles).
    assert case["cycles"] > 0.95 * golden["cycles"]


@pytest.mark.slow
def test_one_wrong_bit_of_the_hardware(tmp_path, monkeypatch, capsys):
    """One wrong least significant bit fails the case, although PSNR stays above the bound."""
    monkeypatch.setattr(
        hard_cases.pipeline, "render", lambda *job: changed(render(*job), (20, 30, 1), 1)
    )
    case = measured(tmp_path, "one", "--engine", "rtl", status=1)["cases"]["one"]
    assert not case["identical"] and not case["passed"] and case["psnr_db_machine"] > PSNR_MIN
    text = capsys.readouterr().out
    assert "1 pixels differ from the golden model's, first (30, 20)" in text and "0 of 1" in text
