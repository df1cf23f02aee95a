"""The viewer's page in headless Chromium shows the golden model's picture."""

import numpy as np
import pytest

from splatcore.app.cli.view import setting_of
from splatcore.app.view.camera import magnification, shape_of
from splatcore.app.view.server import served
from splatcore.golden.pipeline import render
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.source import open_source
from splatcore.spec.config import TINY
from tb.helpers.browser import CHROMIUM, opened, until
from tb.helpers.command import write_scene

PAGE = 900, 480  # pixels; the controls are on the right

LEVELS = 3.0
"""Largest mean error of the screen's picture, in levels of 8 bits. The browser scales 64×48
pixels up sevenfold, as this test does, but rounds differently at edges. A mirrored picture has
an error of 40 or more."""

NOTE = "document.querySelectorAll('[class*=Notification] button')"
"""Buttons that close viser's notice about drawing without a GPU, which covers the page."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is missing: apt-get install chromium"),
]


def canvas(tab) -> tuple[int, int]:
    """Width and height of the canvas, left of the controls."""
    return tuple(
        round(tab.value(f"document.querySelector('canvas').getBoundingClientRect().{side}"))
        for side in ("width", "height")
    )


def seen(tab, shape) -> tuple[np.ndarray, np.ndarray]:
    """The screen where it has pixels of the picture [48, 64, 3], and where it has them [48, 64]."""
    wide, high = canvas(tab)
    scale = magnification(shape, (wide, high))
    across = scale * shape[0] / 64
    screen = tab.screenshot()[:high, :wide].astype(float)
    rows = ((high - 48 * scale) / 2 + scale * (np.arange(48) + 0.5)).astype(int)
    columns = ((wide - 64 * across) / 2 + across * (np.arange(64) + 0.5)).astype(int)
    inside = ((rows >= 0) & (rows < high))[:, None] & (columns >= 0) & (columns < wide)
    return screen[rows.clip(0, high - 1)][:, columns.clip(0, wide - 1)], inside


def test_the_screen_shows_the_golden_picture(tmp_path, monkeypatch):
    """The screen shows the golden picture of the first camera, then of a chosen camera, then of
    the view after a drag of the mouse."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    source = open_source("scene.ply")
    setting = setting_of(source, "cameras.json:7", "64x48", TINY, None)
    model, _ = pack(source.scene, TINY)
    checked = []

    def error() -> float:
        """The mean error of the screen's picture."""
        screen, inside = seen(tab, shape_of(page.asked))
        return np.abs(screen - golden())[inside].mean()

    def golden() -> np.ndarray:
        return render(TINY, model, page.asked).pixels.astype(float)

    def check():
        """Wait for the right picture, and check that it differs from all earlier ones."""
        until(lambda: page.asked and error() < LEVELS)
        checked.append(golden())
        far = [np.abs(one - checked[-1]).mean() for one in checked[:-1]]
        assert all(error > 3 * LEVELS for error in far), far

    with (
        served(source.name, source.reading, setting, "127.0.0.1", 0) as (address, pages),
        opened(address, tmp_path / "browser", *PAGE) as tab,
    ):
        until(lambda: pages)
        page = next(iter(pages.values()))
        until(lambda: tab.value(f"{NOTE}.length"))
        tab.value(f"{NOTE}.forEach(each => each.click())")
        begin = render(TINY, model, setting.camera).pixels
        until(lambda: page.asked and np.abs(golden() - begin).mean() < 0.5)
        check()
        page.go(setting.cameras[0])
        check()
        wide, high = canvas(tab)
        tab.drag((wide // 2, high // 2), (wide // 4, high // 2))
        check()
