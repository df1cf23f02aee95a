"""The viewer's pictures and numbers, against golden model, reference and cycle model."""

import signal
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from splatcore.app.view import layers, text
from splatcore.app.view.studio import CHOOSING, KEPT_CAMERAS, Request, Shown, Studio
from splatcore.app.view.worker import INTERRUPT, Failed, Progress, serve
from splatcore.golden import pipeline, reference
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.frame import frame_cycles, group_cycles
from splatcore.sim.frame.metric import LEVELS, psnr
from splatcore.sim.frame.picture import error_picture
from splatcore.sim.frame.source import Source
from splatcore.spec.config import TINY
from splatcore.spec.convention import TILE
from splatcore.spec.error import InputError

FIRST = SimpleNamespace(value=1)  # the number of a first request

SIZE = 60, 44  # ends within a tile, and within a group, on both axes


@pytest.fixture(scope="module")
def scene():
    return generate("garden", 400)


@pytest.fixture(scope="module")
def camera():
    return generated_camera("garden").resized(*SIZE)


@pytest.fixture(scope="module")
def model(scene):
    return pack(scene, TINY)[0]


@pytest.fixture(scope="module")
def frame(model, camera):
    return pipeline.render(TINY, model, camera)


@pytest.fixture(scope="module")
def studio(scene):
    return Studio(Source("garden", scene=scene))


def last(studio, *request, **more) -> Shown:
    """Run a request; return its last answer."""
    *_, shown = studio.steps(Request(*request, **more), lambda text, share: None)
    assert shown.done
    return shown


def lengths(frame, config) -> np.ndarray:
    """Number of splats per tile [rows, columns], counted entry by entry."""
    height, width = frame.pixels.shape[:2]
    rows, columns = -(-height // TILE), -(-width // TILE)
    across = -(-columns // config.group)
    found = np.zeros((rows + config.group, columns + config.group), int)
    for group, mask in zip(frame.binned.group, frame.binned.entries["mask"], strict=True):
        for bit in range(config.group**2):
            row, column = divmod(int(group), across)
            down, right = divmod(bit, config.group)
            found[row * config.group + down, column * config.group + right] += int(mask) >> bit & 1
    assert not found[rows:].any() and not found[:, columns:].any()
    return found[:rows, :columns]


def test_each_layer(studio, scene, model, frame, camera):
    of_model = reference.render(model.gaussians(), camera).pixels
    of_scene = reference.render(scene.gaussians(), camera).pixels
    expected = {
        layers.MACHINE: frame.pixels, layers.MODEL: of_model, layers.SCENE: of_scene,
        layers.ERROR_MODEL: error_picture(frame.pixels, of_model),
        layers.ERROR_SCENE: error_picture(frame.pixels, of_scene),
        layers.TILES: layers.map_picture(lengths(frame, TINY), TILE, *SIZE),
        layers.GROUPS: layers.map_picture(group_cycles(TINY, frame), TILE * TINY.group, *SIZE),
    }  # fmt: skip
    assert list(expected) == list(layers.LAYERS)
    assert len({picture.tobytes() for picture in expected.values()}) == len(expected)
    for layer, pixels in expected.items():
        shown = last(studio, camera, TINY, "compact", layer)
        np.testing.assert_array_equal(shown.pixels, pixels, layer)
        assert shown.facts["layer"] == layer


def test_the_picture_comes_first(studio, camera):
    """The machine's picture is sent before cycles are counted and any reference is rendered."""
    calls = []
    moved = replace(camera, translation=camera.translation + 0.01)
    shown = next(studio.steps(Request(moved, TINY), lambda *call: calls.append(call)))
    assert shown.pixels is not None and not shown.done and "cycles" not in shown.facts
    assert text.facts_text(shown.facts) == "**machine (golden)**, TINY, compact, 60×44"
    assert not [text for text, _ in calls if "reference" in text]
    assert [share for text, share in calls if "golden" in text] == [0, 0.25, 0.5, 0.75]


def test_numbers(studio, scene, model, frame, camera):
    facts = last(studio, camera, TINY).facts
    found = frame_cycles(TINY, frame)
    assert facts["cycles"]["frame"] == found.frame and facts["quality"] == "compact"
    for name, exact in (("machine", model.gaussians()), ("scene", scene.gaussians())):
        drawn = reference.render(exact, camera).pixels
        db = psnr(frame.pixels / LEVELS, drawn / LEVELS)
        assert facts[f"psnr_db_{name}"] == pytest.approx(db)
        assert f"{db:.2f}" in text.facts_text(facts)
    printed = text.facts_text(facts)
    for part in (f"{found.frame:,}", f"{found.raster:,}", "TINY, compact, 60×44"):
        assert part in printed
    half, stage = found.binding
    assert f"Bottleneck: **{stage}** in {half}" in printed
    assert getattr(found, half) == found.frame
    others = {"rendering": ("sort", "raster")}.get(half, ("cull", "place", "project", "bin"))
    assert getattr(found, stage) == max(getattr(found, each) for each in others)


def test_cycles_of_groups(frame):
    cycles = group_cycles(TINY, frame)
    counts = np.diff(frame.start).reshape(cycles.shape)
    assert cycles.shape == (2, 2) and ((cycles > 0) == (counts > 0)).all()
    whole = frame_cycles(TINY, frame).rendering
    assert 0.5 * whole < cycles.sum() < whole


def test_a_packed_model(model, frame, camera):
    """A packed model is its own scene: both references are the same."""
    studio = Studio(Source("packed", model=model))
    one, other = (last(studio, camera, TINY, None, layer) for layer in (layers.MODEL, layers.SCENE))
    np.testing.assert_array_equal(one.pixels, other.pixels)
    assert one.facts["quality"] is None and "psnr_db_scene" not in one.facts


def test_too_large(studio, camera):
    with pytest.raises(InputError, match="TINY renders up to 64x64"):
        last(studio, camera.resized(65, 40), TINY)


def test_pictures_are_kept_per_camera(scene, camera, monkeypatch):
    """For a camera that comes back nothing is rendered again, except the frame that a map needs."""
    calls, rendered = [], pipeline.render
    exact = reference.render
    monkeypatch.setattr(
        pipeline, "render", lambda *a, **k: calls.append("golden") or rendered(*a, **k)
    )
    monkeypatch.setattr(
        reference, "render", lambda *a, **k: calls.append("exact") or exact(*a, **k)
    )
    studio, other = Studio(Source("garden", scene=scene)), replace(camera, fx=1.1 * camera.fx)
    first = last(studio, camera, TINY, "compact")
    last(studio, other, TINY, "compact")
    assert sorted(calls) == ["exact"] * 4 + ["golden"] * 2
    calls.clear()
    again = last(studio, replace(camera, name="again"), TINY, "compact")
    np.testing.assert_array_equal(again.pixels, first.pixels)
    assert again.facts == first.facts and not calls
    last(studio, camera, TINY, "compact", layers.TILES)
    assert calls == ["golden"]
    calls.clear()
    last(studio, camera, replace(TINY, name="OTHER"), "compact")
    assert sorted(calls) == ["exact", "golden"]  # the scene's picture is the same for all machines
    for step in range(KEPT_CAMERAS):
        next(studio.steps(Request(replace(camera, fy=40 + step), TINY, "compact"), print))
    assert len(studio._views) == KEPT_CAMERAS and len(studio._frames) == 1
    calls.clear()
    last(studio, camera, TINY, "compact")
    assert "golden" in calls


@pytest.mark.parametrize("at", [0, 3, 6])
def test_a_newer_request_ends_the_work(scene, camera, at):
    """Once a newer request exists, nothing more is sent, at whatever stage the work is."""
    newest, sent = SimpleNamespace(value=1), []

    def send(answer):
        sent.append(answer)
        if len(sent) == at + 1:
            newest.value = 2

    studio, request = Studio(Source("garden", scene=scene)), Request(camera, TINY, "compact")
    serve(studio, 1, request, send, newest, FIRST)
    assert len(sent) == at + 1 and all(number == 1 for number, _ in sent)


@pytest.mark.parametrize("changed", [1, 2])
def test_packing_goes_on_while_the_camera_moves(scene, camera, changed):
    """It ends only for a request of another quality; its progress goes to the newest request."""
    newest, sent = SimpleNamespace(value=1), []
    studio = Studio(Source("garden", scene=scene))

    def send(answer):
        sent.append(answer)
        newest.value = 2

    serve(studio, 1, Request(camera, TINY), send, newest, SimpleNamespace(value=changed))
    begun, packing = (
        (1, Progress(CHOOSING, None)),
        (2, Progress(f"{CHOOSING}: packing: compact", None)),
    )
    assert sent == [begun, packing][: 3 - changed]
    assert bool(studio.source.packings) == bool(studio._chosen) == (changed == 1)
    assert not studio.packing and not studio._frames


def test_a_signal_ends_a_step(scene, camera, monkeypatch):
    """A signal ends a step that reports no progress; without a newer request it changes nothing."""
    newest, reached = SimpleNamespace(value=1), []

    def rendered(*arguments, **more):
        signal.raise_signal(INTERRUPT)
        reached.append(1)
        newest.value = 2
        signal.raise_signal(INTERRUPT)
        reached.append(2)

    monkeypatch.setattr(pipeline, "render", rendered)
    studio, sent = Studio(Source("garden", scene=scene)), []
    serve(studio, 1, Request(camera, TINY, "compact"), sent.append, newest, FIRST)
    assert reached == [1] and not any(isinstance(one, Failed) for _, one in sent)


def test_failures_are_reported(studio, camera):
    sent = []
    request = Request(camera.resized(640, 360), TINY)
    serve(studio, 1, request, lambda answer: sent.append(answer[1]), FIRST, FIRST)
    assert len(sent) == 1 and isinstance(sent[0], Failed) and "picture of 640x360" in sent[0].why


@pytest.mark.slow
def test_simulation(studio, frame, camera):
    sent = []
    request = Request(camera, TINY, layer=layers.RTL)
    serve(studio, 1, request, lambda answer: sent.append(answer[1]), FIRST, FIRST)
    np.testing.assert_array_equal(sent[-1].pixels, frame.pixels)
    assert "identical to the golden model" in text.rtl_text(sent[-1].facts)
    assert any(isinstance(one, Progress) and "simulating" in one.text for one in sent)
