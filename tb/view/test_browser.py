"""The page in Chromium without a screen: what it draws is the golden model's picture."""

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.model.pack.pack import pack
from splatcore.sim.cli.view import setting_of
from splatcore.sim.common.source import open_source
from splatcore.sim.view.server import served
from splatcore.spec.config import TINY
from tb.helpers.browser import CHROMIUM, opened, until
from tb.helpers.command import write_scene

PAGE = 900, 480  # its right part holds the switches

LEVELS = 3.0
"""Mean error of the screen's picture: the browser stretches 64×48 pixels sevenfold, as the test
does, but with its own rounding at every edge. Of a picture that is mirrored it is 40 and
more."""

NOTE = "document.querySelectorAll('[class*=Notification] button')"
"""Buttons that close what viser says of drawing without a GPU, which covers a part of the page."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is missing: apt-get install chromium"),
]


def canvas(tab) -> tuple[int, int]:
    """Width and height of what the page draws the scene on, left of the switches."""
    return tuple(
        round(tab.value(f"document.querySelector('canvas').getBoundingClientRect().{side}"))
        for side in ("width", "height")
    )


def seen(tab) -> np.ndarray:
    """The picture on the screen [48, 64, 3], without its borders: means of the screen's pixels."""
    wide, high = canvas(tab)
    scale = min(wide / 64, high / 48)
    screen = tab.screenshot()[:high, :wide].astype(float)
    left, top = (wide - 64 * scale) / 2, (high - 48 * scale) / 2
    rows = (top + scale * (np.arange(48) + 0.5)).astype(int)
    columns = (left + scale * (np.arange(64) + 0.5)).astype(int)
    return screen[rows][:, columns]


def test_what_is_on_the_screen(tmp_path, monkeypatch):
    """The golden model's picture of the camera that the page begins with; of another one that it
    is sent to; of where the mouse then moves it."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    source = open_source("scene.ply")
    setting = setting_of(source, "cameras.json:7", "64x48", TINY, None)
    model, _ = pack(source.scene, TINY)
    checked = []

    def golden() -> np.ndarray:
        return render(TINY, model, page.asked).pixels.astype(float)

    def check():
        """The picture comes and is right; no other one before is."""
        until(lambda: page.asked and np.abs(seen(tab) - golden()).mean() < LEVELS)
        checked.append(golden())
        far = [np.abs(one - checked[-1]).mean() for one in checked[:-1]]
        assert all(error > 3 * LEVELS for error in far), far

    with (
        served(source, setting, "127.0.0.1", 0) as (address, pages),
        opened(address, tmp_path / "browser", *PAGE) as tab,
    ):
        until(lambda: pages)
        page = next(iter(pages.values()))
        until(lambda: tab.value(f"{NOTE}.length"))
        tab.value(f"{NOTE}.forEach(each => each.click())")
        check()
        begin = render(TINY, model, setting.camera).pixels
        assert np.abs(checked[0] - begin).mean() < 0.5
        page.go(setting.cameras[0])
        check()
        wide, high = canvas(tab)
        tab.drag((wide // 2, high // 2), (wide // 4, high // 2))
        check()
