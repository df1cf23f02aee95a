"""Headless Chromium, controlled by its DevTools protocol."""

import base64
import io
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

OPTIONS = (
    "--headless=new --no-sandbox --disable-gpu-sandbox --use-gl=angle --use-angle=swiftshader "
    "--enable-unsafe-swiftshader --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --hide-scrollbars --remote-debugging-port=0"
)

LONGEST = 120.0  # time limit in seconds


class Tab:
    """A page in Chromium."""

    def __init__(self, socket):
        self.socket, self.number = socket, 0

    def call(self, method: str, **parameters) -> dict:
        """Call a method of the protocol; its result."""
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while (answer := json.loads(self.socket.recv(LONGEST))).get("id") != self.number:
            pass
        assert "error" not in answer, answer
        return answer["result"]

    def screenshot(self) -> np.ndarray:
        """The page's pixels [H, W, 3]."""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def value(self, script: str):
        """Value of a JavaScript expression."""
        result = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        return result["result"].get("value")

    def drag(self, begin: tuple[int, int], end: tuple[int, int]):
        """Drag the mouse from one pixel to another with the left button."""
        for kind, (x, y) in (
            ("Moved", begin),
            ("Pressed", begin),
            ("Moved", end),
            ("Released", end),
        ):
            self.call(
                "Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, button="left",
                buttons=int(kind != "Released"), clickCount=1,
            )  # fmt: skip


@contextmanager
def opened(address: str, folder: Path, width: int, height: int) -> Iterator[Tab]:
    """Open a page of `width` x `height` pixels. folder: a new one for the browser's files."""
    from websockets.sync.client import connect

    command = [CHROMIUM, *OPTIONS.split(), f"--user-data-dir={folder}", "about:blank"]
    silent = subprocess.DEVNULL
    with subprocess.Popen(command, stdout=silent, stderr=silent) as process:
        try:
            file = folder / "DevToolsActivePort"
            until(lambda: file.is_file() and file.read_text().count("\n"))
            port = file.read_text().split("\n")[0]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
                page = next(each for each in json.load(answer) if each["type"] == "page")
            with connect(page["webSocketDebuggerUrl"], max_size=None) as socket:
                tab = Tab(socket)
                tab.call(
                    "Emulation.setDeviceMetricsOverride", width=width, height=height,
                    deviceScaleFactor=1, mobile=False,
                )  # fmt: skip
                tab.call("Page.navigate", url=address)
                yield tab
        finally:
            process.terminate()


def until(condition: Callable[[], object], longest: float = LONGEST):
    """Wait until a condition holds, for at most `longest` seconds."""
    end = time.monotonic() + longest
    while not condition():
        assert time.monotonic() < end, "timeout"
        time.sleep(0.1)
