"""The page without a browser: its picture and text as the camera moves and controls change."""

import time
from dataclasses import replace

import numpy as np
import pytest

from splatcore.app.cli.view import setting_of
from splatcore.app.view import layers, page
from splatcore.app.view.page import BACKGROUND, CHOSEN, KEPT, MOVED, Page
from splatcore.app.view.studio import Shown
from splatcore.app.view.worker import Failed, Progress, Worker
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.sim.frame.picture import read_png
from splatcore.sim.frame.source import open_source
from splatcore.spec.config import TINY
from tb.helpers.browser import until
from tb.helpers.command import run
from tb.helpers.page_client import PageClient

STEP = np.array([0.1, 0, 0])


class Desk:
    """A stand-in for a worker: it records requests and does nothing."""

    def __init__(self):
        self.requests, self.receive, self.cancelled = [], None, 0

    def ask(self, request, receive):
        self.requests.append(request)
        self.receive = receive

    def cancel(self):
        self.cancelled += 1


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "garden.ply"
    write_ply(path, generate("garden", 400))
    return str(path)


@pytest.fixture(scope="module")
def setting(file):
    source = replace(open_source(file), camera=generated_camera("garden"))
    return setting_of(source, None, "60x44", TINY, None)


@pytest.fixture
def opened(setting):
    """A page of 120×100 pixels, its client, and stand-ins for its worker and simulator."""
    client, desk, other = PageClient(120, 100), Desk(), Desk()
    shown = Page(client, setting, desk, lambda: other)
    client.camera.report()  # as the browser does where it has been placed
    until(lambda: desk.requests)
    yield shown, client, desk, other
    shown.close()


def browsing(client) -> bool:
    """Whether the page shows the browser's picture, on the renderer's background."""
    drawn = np.array_equal(client.background, BACKGROUND)
    assert client.splats.visible == drawn
    assert ("*Browser's picture: base colours of " in client.widgets["text 0"].content) == drawn
    return drawn


def pixels(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(100, 256, (44, 60, 3), np.uint8)


def test_the_first_view_is_the_camera_s(opened, setting):
    _, _, desk, _ = opened
    assert len(desk.requests) == 1
    found = desk.requests[0].camera
    for name in ("fx", "fy", "cx", "cy", "rotation", "translation"):
        wanted = getattr(setting.camera, name)
        np.testing.assert_allclose(getattr(found, name), wanted, rtol=1e-9, atol=1e-9)


def test_rest_and_movement(opened, monkeypatch):
    """The page shows a picture only when the camera rests, and ignores pictures of old requests."""
    _, client, desk, _ = opened
    monkeypatch.setattr(page, "REST", 0.4)  # a busy machine takes longer for five steps
    desk.receive(Progress("choosing a quality", 0.5))
    assert client.widgets["bar"].value == 50 and browsing(client)
    assert client.widgets["text 0"].content.startswith("choosing a quality\n\n")
    assert not client.background.any()
    desk.receive(Shown(pixels(0)))
    desk.receive(Progress("counting cycles", None))
    assert not browsing(client)
    np.testing.assert_array_equal(client.background, pixels(0)[:, 10:50])  # fills the page
    late, begin = desk.receive, time.monotonic()
    for _ in range(5):
        client.camera.step(STEP)
        assert browsing(client) and desk.cancelled == 1
        assert client.widgets["text 0"].content.startswith(MOVED)
        time.sleep(page.REST / 5)
    late(Shown(pixels(0)))
    assert browsing(client) and len(desk.requests) == 1
    until(lambda: len(desk.requests) == 2)
    assert time.monotonic() - begin > page.REST * 9 / 5
    first, second = (request.camera for request in desk.requests)
    np.testing.assert_allclose(second.position - first.position, 5 * STEP, atol=1e-9)
    desk.receive(Shown(pixels(1)))
    np.testing.assert_array_equal(client.background, pixels(1)[:, 10:50])


def test_a_picture_is_sent_once(opened):
    """Later answers with the same picture add numbers; a second copy would delay them."""
    _, client, desk, _ = opened
    for _ in range(2):
        desk.receive(Shown(pixels(0)))
        shown = client.background
        desk.receive(Shown(pixels(0)))
        assert client.background is shown
        client.camera.step(STEP)
        until(lambda: desk.requests[-1].camera is not None and client.splats.visible)
        until(lambda: len(desk.requests) == 2)


def test_another_model(opened):
    """While another quality is packed, the page shows the browser's picture again."""
    _, client, desk, _ = opened
    for label, value, browses in (
        ("Show", layers.TILES, False),
        ("Size", "982x720", False),
        ("Quality", "compact", True),
        ("Preset", "DEFAULT", True),
    ):
        desk.receive(Shown(pixels(0)))
        client.widgets[label].change(value)
        desk.receive(Progress("packing", None))
        assert browsing(client) == browses, label


def test_a_camera_that_stays_is_no_movement(opened):
    _, client, desk, _ = opened
    desk.receive(Shown(pixels(0)))
    client.camera.report()
    assert not client.splats.visible and not desk.cancelled


def test_another_size_of_the_page(opened):
    """A narrower page requests the same camera, and its own field of view grows."""
    _, client, desk, _ = opened
    client.camera.image_width = 60
    client.camera.report()
    until(lambda: len(desk.requests) == 2)
    one, other = (request.camera for request in desk.requests)
    assert other.fy == pytest.approx(one.fy) and other.fx == pytest.approx(one.fx)
    assert client.camera.fov > 1.2 * 2 * np.arctan(22 / one.fy)


def test_switches(opened):
    _, client, desk, _ = opened
    changes = {"Show": layers.TILES, "Quality": "compact", "Preset": "DEFAULT", "Size": "982x720"}
    for label, value in changes.items():
        client.widgets[label].change(value)
    request = desk.requests[-1]
    assert len(desk.requests) == 5 and client.widgets["Quality"].options[0] == CHOSEN
    assert (request.layer, request.quality) == (layers.TILES, "compact")
    assert request.config.name == "DEFAULT"
    assert (request.camera.width, request.camera.height) == (982, 720)
    client.widgets["Preset"].change("TINY")
    assert (desk.requests[-1].camera.width, desk.requests[-1].camera.height) == (64, 47)


def test_another_camera(opened, setting):
    """A camera chosen from the list moves the page there and starts a new request."""
    _, client, desk, _ = opened
    client.camera.step(STEP)
    until(lambda: len(desk.requests) == 2)
    desk.receive(Shown(pixels(0)))
    client.widgets["Camera"].change(client.widgets["Camera"].options[0])
    assert browsing(client)
    until(lambda: len(desk.requests) == 3)
    one, other = desk.requests[0].camera, desk.requests[2].camera
    assert page.alike(replace(one, name=""), replace(other, name=""))


def test_failure(opened):
    _, client, desk, _ = opened
    desk.receive(Failed("it cannot be"))
    assert client.widgets["text 0"].content.startswith("it cannot be") and browsing(client)


def test_simulation_goes_on_while_the_camera_moves(opened):
    """Its picture is shown only if the camera has not moved; its result is always shown."""
    _, client, desk, other = opened
    for step in (False, True):
        client.widgets["Simulate in RTL"].change()
        assert other.requests[-1].layer == layers.RTL
        other.receive(Progress("simulating", 0.25))
        line = client.widgets["text 9"]
        assert line.content == "RTL: simulating, 25%"
        if step:
            client.camera.step(STEP)
            until(lambda: len(desk.requests) == 2)
        other.receive(Shown(pixels(2), {"rtl": "identical", "rtl_cycles": 1234}, done=True))
        assert "identical" in line.content and "1,234" in line.content
        assert client.splats.visible == step
    assert not other.cancelled


def test_a_page_that_is_closed(opened):
    shown, client, desk, _ = opened
    shown.close()
    desk.receive(Shown(pixels(0)))
    client.camera.step(STEP)
    time.sleep(2 * page.REST)
    assert client.splats.visible and len(desk.requests) == 1


def test_a_marked_scene(setting):
    """For a marked scene the page notes that the browser draws without opacity compensation."""
    for antialiased in (True, False):
        client = PageClient(120, 100)
        marked = replace(setting, antialiased=antialiased, mark="SPZ flag")
        Page(client, marked, Desk(), Desk).close()
        texts = [widget.content for widget in client.widgets.values() if hasattr(widget, "content")]
        line = "Antialiased (SPZ flag): the browser's own picture is drawn without opacity "
        assert any(text.startswith(line) for text in texts) == antialiased


@pytest.mark.slow
def test_with_a_worker(setting, file, tmp_path, monkeypatch):
    """The newest request wins; a saved camera gives the same picture by `render`."""
    monkeypatch.chdir(tmp_path)
    client, worker = PageClient(78, 44), Worker(file)  # the shape of 60×44 pixels here
    shown = Page(client, setting, worker, lambda: worker)
    try:
        for _ in range(4):  # each while the previous request is running
            client.camera.step(STEP)
            time.sleep(1.5 * page.REST)
        until(lambda: client.widgets["text 0"].content == "done")
        client.widgets["Save camera"].change()
        (tmp_path / KEPT).write_bytes(client.files[KEPT])
        command = "--camera", KEPT, "--engine", "golden", "--preset", "tiny", "-o", "golden.png"
        assert run("render", file, *command, "--no-compare") == 0
        golden = read_png("golden.png")
        np.testing.assert_array_equal(client.background, golden)
        assert "Bottleneck" in client.widgets["text 10"].content
        client.widgets["Show"].change(layers.TILES)
        until(lambda: not np.array_equal(client.background, golden))
        worker._process.kill()
        until(lambda: "has ended" in client.widgets["text 0"].content)
    finally:
        shown.close()
        worker.close()
