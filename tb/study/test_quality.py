"""Packing by quality and by target PSNR, and `bench quality`, on a scene of degree 3."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from splatcore.golden import pipeline
from splatcore.golden.reference import render
from splatcore.model.formats.model_file import read_model
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.model.pack.stored import stored_scene
from splatcore.sim.frame import choose
from splatcore.sim.frame.budget import bytes_by_part, psnr_by_part
from splatcore.sim.frame.metric import psnr
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import Source
from splatcore.spec.colour import COARSE, FINE
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.memory import CHUNK
from splatcore.spec.scene import Scene
from splatcore.study.bench.quality import read_bytes
from tb.helpers.command import check_documented, load, run

CAMERA = generated_camera("garden", 96, 54)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A garden whose left half has harmonics of degree 3."""
    flat = generate("garden", 2500)
    sh = np.zeros((len(flat), 16, 3))
    sh[:, :4] = flat.sh
    left = flat.position[:, 0] < np.median(flat.position[:, 0])
    sh[left, 4:] = np.random.default_rng(0).normal(0, 0.1, (left.sum(), 12, 3))
    return replace(flat, sh=sh)


def test_the_smallest_that_is_good_enough(scene):
    """The first quality that reaches the target is chosen; PSNR equals the rendered pictures'."""
    found = {least: choose.choose(scene, DEFAULT, [CAMERA], least=least) for least in (10, 40, 50)}
    assert [packed.quality for packed in found.values()] == ["compact", "balanced", "faithful"]
    for packed in found.values():
        pictures = [render(g.gaussians(), CAMERA).pixels / 255 for g in (packed.model, scene)]
        assert psnr(*pictures) == pytest.approx(packed.psnr_db)
    plain = choose.choose(scene.with_sh_degree(0), DEFAULT, [CAMERA])
    assert plain.quality == "faithful" and plain.model.bytes_per_gaussian < 22
    assert choose.choose(scene, PAPER, [CAMERA]).quality == "compact"


def test_the_scene_is_rendered_once(scene, monkeypatch):
    """Choosing a quality, a target PSNR and the parts' errors share one rendering of the scene."""
    seen, drawn = choose.Views.of(scene, [CAMERA]), choose.render
    assert choose.Views.of(scene, seen) is seen
    rendered = []

    def counted(gaussians, camera):
        rendered.append(gaussians.position)
        return drawn(gaussians, camera)

    monkeypatch.setattr(choose, "render", counted)
    packed = choose.choose(scene, DEFAULT, seen, "faithful")
    assert len(rendered) == 1
    assert choose.smallest(scene, DEFAULT, seen, 20.0).quality == "compact"
    assert np.array_equal(packed.exact, render(scene.gaussians(), CAMERA).pixels)
    assert np.array_equal(packed.drawn, render(packed.model.gaussians(), CAMERA).pixels)
    assert packed.camera is CAMERA
    psnr_by_part(scene, packed.model, seen)
    assert len(rendered) > 7 and not any(array is scene.position for array in rendered)
    choose.Views.of(scene, [CAMERA])
    assert rendered[-1] is scene.position  # the counter works


def test_chunk_by_chunk(scene):
    """More dB take more bytes; an unreachable target gives the best model."""
    targets = (42.0, 48.0, 90.0)
    found = [choose.smallest(scene, DEFAULT, [CAMERA], db) for db in targets]
    sizes = [len(packed.model.image) for packed in found]
    assert sizes == sorted(set(sizes))
    assert all(p.psnr_db >= db for p, db in zip(found[:-1], targets[:-1], strict=True))
    best = choose.choose(scene, DEFAULT, [CAMERA], "faithful")
    assert found[-1].psnr_db <= 90 and found[-1].psnr_db >= best.psnr_db - 0.1
    assert sizes[-1] <= len(best.model.image)


def test_a_source_is_packed_once(scene):
    source = Source("a garden", scene=scene)
    first, compact = Shot(source, CAMERA), Shot(source, CAMERA, quality="compact")
    assert Shot(source, CAMERA, replace(DEFAULT, pes=3)).packed is first.packed
    assert Shot(source, CAMERA, quality=first.packed.quality).packed is first.packed
    assert compact.packed is not first.packed
    assert compact.packing["quality"] == "compact"
    assert "packed as compact: 21.79 bytes per Gaussian" in compact.packing_line


def test_budget(scene):
    """Bytes of the parts sum to the whole; each part alone loses less than all together."""
    packed = choose.choose(scene, DEFAULT, [CAMERA], "faithful")
    sizes = bytes_by_part(packed.model)
    assert sum(sizes.values()) == pytest.approx(packed.model.bytes_per_gaussian)
    third = np.mean(np.repeat(packed.model.chunks["harmonics"] == FINE, CHUNK)[: len(scene)])
    assert 0.4 < third < 1
    bits = {
        "chunk headers": 256 * len(packed.model.chunk_beats) / len(scene), "positions": 45,
        "shape": 93, "opacity": 8, "colour": 27, "degree 1": 2 + 9 * 5, "degree 2": 2 + 15 * 5,
        "degree 3": (2 + 21 * 6) * third,
    }  # fmt: skip
    assert {part: 8 * sizes[part] for part in bits} == pytest.approx(bits)
    losses = psnr_by_part(scene, packed.model, [CAMERA])
    assert list(losses) == [part for part in bits if part != "chunk headers"]
    assert all(db > packed.psnr_db for db in losses.values())  # none is None, a part without loss
    compact = choose.choose(scene, DEFAULT, [CAMERA], "compact")
    assert psnr_by_part(scene, compact.model, [CAMERA])["degree 3"] < compact.psnr_db + 3
    assert bytes_by_part(compact.model)["codebooks"] > 0
    half = bytes_by_part(choose.choose(scene, DEFAULT, [CAMERA], "small").model)
    bits = {"shape": 32, "opacity": 5, "colour": 13, "degree 1": 14}
    assert {part: 8 * half[part] for part in bits} == bits


def test_a_gaussian_at_the_camera(scene):
    """A Gaussian at the camera has no direction; chunks still get their harmonics, no warnings."""
    place = scene.position.copy()
    place[np.argmax(scene.opacity)] = CAMERA.position
    there = replace(scene, position=place)
    with warnings.catch_warnings(action="error"):
        steps = choose.upgrades(there, DEFAULT, [CAMERA], str)
    left = [chunk for chunk, kind in steps if kind == COARSE]
    assert len(left) == len(set(left)) >= 5


def test_lost_coefficients(scene, tmp_path, monkeypatch, capsys):
    """A coefficient out of range is reported by one line on standard error and in JSON."""
    monkeypatch.chdir(tmp_path)
    sh = scene.sh.copy()
    sh[:, 3, 1] = np.where(np.arange(len(sh)) == 9, 1000, sh[:, 3, 1])
    for name, lost in (("plain.ply", False), ("odd.ply", True)):
        write_ply(name, replace(scene, sh=sh) if lost else scene)
        assert run(f"pack {name} -o s.splatcore --quality faithful --size 16x9 --json p.json") == 0
        printed, facts = capsys.readouterr().err, load(tmp_path / "p.json")
        line = "coefficients out of the range of their steps, off by up to 233 of degree 1\n"
        assert printed.endswith(f"odd.ply: {line}") if lost else "beyond" not in printed
        assert len(facts["sh_error"]) == 3 and (facts["sh_error"][0] > 200) == lost
        check_documented("## `splatcore pack`", facts)


def test_no_step_too_many(scene):
    """Steps are ordered by gain, a chunk's first before its second; one step fewer misses the
    target; a camera that sees nothing has no steps."""
    steps = choose.upgrades(scene, DEFAULT, [CAMERA], str)
    place = {step: n for n, step in enumerate(steps)}
    assert all(place[chunk, COARSE] < n for (chunk, kind), n in place.items() if kind == FINE)
    views = choose.Views.of(scene, [CAMERA])
    found, db = choose.smallest(scene, DEFAULT, [CAMERA], 45.0).model, []
    for count in range(len(steps) + 1):
        layouts = np.zeros(len(found.chunk_beats), int)
        for chunk, kind in steps[:count]:
            layouts[chunk] = kind
        model, _ = pack(scene, quality=layouts)
        db.append(views.psnr_db(model.gaussians()))
        if (model.image == found.image[: len(model.image)]).all():
            break
    assert db[-1] >= 45.0 > db[-2]
    order = stored_scene(scene, model.format).index
    strong = scene.sh.copy()
    strong[order[5 * CHUNK : 6 * CHUNK], 4:] *= 10
    strong = choose.upgrades(replace(scene, sh=strong), DEFAULT, [CAMERA], str)
    assert strong[0] == (5, COARSE)
    away = replace(CAMERA, translation=CAMERA.translation - [0, 0, 1000])
    assert choose.upgrades(scene, DEFAULT, [away], str) == []


def test_second_steps_come_after_the_first(scene, monkeypatch):
    """A chunk's second step follows its first even if it gains more; no gain, no steps."""
    errors = [10, 10, 3, 1], [9, 5, 5, 1], [0, 4, 0, 0]  # per chunk, of four; the others are 0
    rest = len(scene) - 4 * CHUNK
    found = iter([np.pad(np.repeat(error, CHUNK), (0, rest)) for error in errors])
    monkeypatch.setattr(choose, "seen_error", lambda *_: next(found))
    steps = [(1, COARSE), (0, COARSE), (0, FINE), (1, FINE)]
    assert choose.upgrades(scene, DEFAULT, [CAMERA], str) == steps


def test_bisection(scene, monkeypatch):
    """With one dB per step, `smallest` finds the minimum number of 20 steps for every target."""
    steps = [(chunk, kind) for kind in (1, 2) for chunk in range(10)]

    def made(*_, quality):
        return SimpleNamespace(gaussians=lambda: int(quality.sum())), None

    def judged(model, *_):
        return SimpleNamespace(psnr_db=float(model.gaussians()))

    views = SimpleNamespace(of=lambda *_: SimpleNamespace(judged=judged, cameras=[CAMERA]))
    first = SimpleNamespace(psnr_db=-1.0)
    fakes = {"upgrades": lambda *_: steps, "pack": made, "Views": views, "choose": lambda *_: first}
    for name, fake in fakes.items():
        monkeypatch.setattr(choose, name, fake)
    for target in range(23):
        found = choose.smallest(scene, DEFAULT, [CAMERA], target)
        assert found.psnr_db == min(target, 20)
    assert choose.smallest(scene, DEFAULT, [CAMERA], -2) is first


def test_the_worst_view_counts(scene):
    other = generated_camera("garden", 48, 27)
    each = [choose.choose(scene, DEFAULT, [c], "balanced").psnr_db for c in (CAMERA, other)]
    for views in ([CAMERA, other], [other, CAMERA]):
        assert choose.choose(scene, DEFAULT, views, "balanced").psnr_db == min(each) < max(each)


@pytest.mark.parametrize(("quality", "bits"), [("compact", 45), ("small", 27)])
def test_bytes_that_a_frame_reads(scene, quality, bits):
    """Bytes read: a header per chunk, a record per Gaussian, harmonics of visible ones."""
    model, _ = pack(scene, DEFAULT, 1, quality=quality)
    frame = pipeline.render(DEFAULT, model, CAMERA)
    points = frame.points
    beats = len({n // 2 if quality == "small" else n for n in points.inside.tolist()})
    chunks = -(-len(model) // 256)
    expected = 32 * chunks + bits * len(points.points) // 8 + 16 * beats
    assert read_bytes(frame, model) == expected


@pytest.mark.slow
def test_commands(scene, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_ply("s.ply", scene)
    assert run("pack s.ply -o s.splatcore --psnr 40 --size 96x54 --json p.json") == 0
    facts = load(tmp_path / "p.json")
    assert facts["quality"] == "40 dB" and facts["psnr_db_packing"] >= 40
    assert read_model("s.splatcore").bytes_per_gaussian == facts["bytes_per_gaussian"]
    assert run("pack s.ply -o t.splatcore --psnr 40 --quality compact") == 2
    assert run("bench quality s.ply -o q --size 96x54 --psnr 40") == 0
    rows = load(tmp_path / "q" / "quality.json")["rows"]
    assert [row["asked"] for row in rows] == ["compact", "balanced", "faithful", "40 dB"]
    assert rows[0]["psnr_db_scene"] < rows[1]["psnr_db_scene"] < rows[2]["psnr_db_scene"]
    assert all(row["psnr_db_machine"] > 52 for row in rows)
    assert all(rows[0][f"{key}_{of}"] is not None for of in ("scene", "machine", "packing")
               for key in ("psnr_db", "ssim", "max_error"))  # fmt: skip
    assert rows[2]["psnr_db_packing_by_part"]["colour"] > rows[2]["psnr_db_packing"]
    reads = [row["model_bytes"] for row in rows]
    assert reads[0] < reads[3] < reads[1] < reads[2]
    assert all((tmp_path / "q" / name).is_file() for name in ("quality.png", "s-faithful.png"))
    assert "40 dB" in capsys.readouterr().out
