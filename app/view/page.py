"""The page: the browser draws the splats; once the camera rests, the machine's picture is shown.

The browser's picture also stands in for the machine's as long as another model is packed.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from splatcore.app.view import layers, text
from splatcore.app.view.camera import (
    Pose,
    Size,
    camera_of,
    fitting,
    framed,
    level_up,
    pose_of,
    shape_of,
)
from splatcore.app.view.drawn import Drawn
from splatcore.app.view.studio import Request, Shown
from splatcore.app.view.worker import Failed, Progress, Worker
from splatcore.model.formats.camera_file import cameras_json
from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.machine.path import target
from splatcore.spec.camera import SIZE_MAX, Camera
from splatcore.spec.config import PRESETS, Config
from splatcore.spec.convention import SPLATCORE

REST = 0.08
"""Seconds without a movement after which the camera rests; the browser reports one every 20 ms."""

SIDES = (360, 720, 1080)  # heights of pictures to choose from
CHOSEN = "smallest that is good enough"
KEPT = "camera.json"  # file name of a saved camera
BEGIN = "initial view"
MOVED = "the camera moves"

BACKGROUND = np.full((2, 2, 3), np.rint(np.multiply(SPLATCORE.background, 255)), np.uint8)
"""Picture [2, 2, 3] behind the splats that the browser draws: the renderer's background."""


@dataclass(frozen=True)
class Setting:
    """The initial state of a page.

    cameras: cameras to choose from
    up: [3], up direction of the scene
    drawn: Gaussians that the browser draws
    mark: reason why the scene is antialiased or not
    notes: lines on unusual contents
    """

    camera: Camera
    cameras: list[Camera]
    up: np.ndarray
    config: Config
    quality: str | None
    drawn: Drawn
    antialiased: bool = False
    mark: str = ""
    notes: tuple[str, ...] = ()

    @property
    def presets(self) -> dict[str, Config]:
        """Machines to choose from, the initial one first."""
        return {self.config.name: self.config} | PRESETS

    @property
    def sizes(self) -> dict[str, Size]:
        """Sizes of pictures to choose from, all of the camera's shape."""
        own = self.camera.width, self.camera.height
        shapes = [(round(own[0] * side / own[1]), side) for side in SIDES]
        sizes = sorted({own, *(shape for shape in shapes if shape[0] <= SIZE_MAX)})
        return {f"{width}x{height}": (width, height) for width, height in sizes}


class Page:
    """A page in a browser: its camera, its controls, and the answers to its requests.

    client: viser's handle of the page
    worker: serves requests for pictures
    simulator: returns the worker for RTL simulation, which is slow and continues while the camera
        moves
    """

    def __init__(self, client, setting: Setting, worker: Worker, simulator: Callable[[], Worker]):
        self.client, self.setting, self.worker, self.simulator = client, setting, worker, simulator
        self.pose: Pose | None = None  # of the last movement
        self.asked: Camera | None = None  # of the picture shown or requested
        self._moved, self._closed = threading.Event(), False
        self._machine: tuple[str, str] | None = None  # preset and quality of the last request
        self._shown: np.ndarray | None = None  # the picture; None: the browser draws
        self._splats = client.scene.add_gaussian_splats("/splats", **setting.drawn.arrays)
        self._controls()
        self._browse()
        self.go(setting.camera)
        client.camera.on_update(lambda _: self.moved())
        threading.Thread(target=self._watch, daemon=True).start()

    def close(self):
        """End: the browser has closed the page."""
        self._closed = True
        self._moved.set()

    def go(self, camera: Camera):
        """Move the page's camera to a camera."""
        pose, handle = pose_of(camera, self._page), self.client.camera
        with self.client.atomic():
            handle.up_direction = level_up(camera, self.setting.up)
            handle.position = pose.position
            handle.look_at = target(camera, self.setting.drawn.position)
            handle.fov = pose.fov
        self._turn(pose)

    def moved(self):
        """Handle a movement of the camera: show the browser's own drawing until it rests.

        The field of view is the server's alone; a page may still report an older one.
        """
        pose = self._seen()
        if self.pose is not None and not np.isclose(pose.fov, self.pose.fov):
            self.client.camera.fov = self.pose.fov
            pose = replace(pose, fov=self.pose.fov)
        if pose.same(self.pose):
            return
        if self.pose is not None and pose.page != self.pose.page:  # what the picture shows stays
            size = self.setting.camera.width, self.setting.camera.height
            shown = camera_of(self.pose, self.setting.camera, size)
            pose = replace(pose, fov=pose_of(shown, pose.page).fov)
            self.client.camera.fov = pose.fov
        self._turn(pose)

    def _turn(self, pose: Pose):
        """Set a new pose: cancel the request and replace the machine's picture by the browser's."""
        self.pose = pose
        if self.asked is not None:
            self.asked = None
            self.worker.cancel()
            self._browse()
            self._progress(Progress(MOVED, 0.0))
        self._moved.set()

    def ask(self, layer: str | None = None):
        """Request a picture of the current view, as the controls say.

        layer: instead of the selected one
        """
        config = self.setting.presets[self.preset.value]
        wanted = self.setting.sizes[self.size.value]
        size = fitting(config, wanted)
        camera = camera_of(self.pose or self._seen(), self.setting.camera, size, "view")
        quality = None if self.quality.value == CHOSEN else self.quality.value
        request = Request(camera, config, quality, layer or self.layer.value)
        if layer == layers.RTL:
            worker = self.simulator()
            worker.ask(request, lambda answer: self._simulated(request, answer))
            return
        self.asked = camera
        if (machine := (self.preset.value, self.quality.value)) != self._machine:
            self._machine = machine
            self._browse()
        self.worker.ask(request, lambda answer: self._answered(request, answer))

    def keep(self):
        """Download the camera of the picture, as a file for `--camera`."""
        if self.asked is not None:
            self.client.send_file_download(KEPT, cameras_json([self.asked]).encode())

    def _watch(self):
        """Request a picture each time the camera comes to rest, until the page is closed."""
        while not self._closed:
            self._moved.wait()
            self._moved.clear()
            while self._moved.wait(REST):
                self._moved.clear()
            if not self._closed:
                self.ask()

    def _answered(self, request: Request, answer: Progress | Shown | Failed):
        if self.asked is not request.camera or self._closed:
            return
        if isinstance(answer, Shown):
            if answer.pixels is not None:
                self._show(answer.pixels)
            self.facts.content = text.facts_text(answer.facts)
            answer = Progress("done", 1.0) if answer.done else None
        if answer:
            self._progress(answer)

    def _simulated(self, request: Request, answer: Progress | Shown | Failed):
        """Handle an answer of the simulation; show its picture if the camera has not moved."""
        if self._closed:
            return
        if isinstance(answer, Progress):
            share = "" if answer.share is None else f", {answer.share:.0%}"
            self.rtl_text.content = f"RTL: {answer.text}{share}"
        elif isinstance(answer, Failed):
            self.rtl_text.content = f"RTL: {answer.why}"
        else:
            self.rtl_text.content = text.rtl_text(answer.facts)
            now = self.asked
            if answer.pixels is not None and now is not None and alike(now, request.camera):
                self._show(answer.pixels)

    def _show(self, pixels: np.ndarray):
        """Show a picture, unless it is shown already: encoding takes a tenth of a second."""
        if self._shown is None or not np.array_equal(pixels, self._shown):
            self._shown = pixels
            whole = framed(pixels, shape_of(self.asked), self._page)
            self.client.scene.set_background_image(whole, format="png")
            self._splats.visible = False

    def _browse(self):
        """Show the browser's picture, on the renderer's background."""
        self._shown, self._splats.visible = None, True
        self.client.scene.set_background_image(BACKGROUND, format="png")

    def _progress(self, answer: Progress | Failed):
        share = answer.share if isinstance(answer, Progress) else 0.0
        line = answer.text if isinstance(answer, Progress) else answer.why
        drawn = "" if self._shown is not None else text.drawn_text(self.setting.drawn)
        self.status.content = f"{line}\n\n{drawn}".strip()
        self.bar.animated = share is None
        self.bar.value = 100 if share is None else 100 * share

    @property
    def _page(self) -> Size:
        return self.client.camera.image_width, self.client.camera.image_height

    def _seen(self) -> Pose:
        """Return the current pose of the page's camera."""
        handle = self.client.camera
        turned = Rotation.from_quat(handle.wxyz, scalar_first=True).as_matrix()
        return Pose(turned, np.array(handle.position), float(handle.fov), self._page)

    def _controls(self):
        """Create the controls and connect them."""
        gui, setting = self.client.gui, self.setting
        if setting.antialiased:
            gui.add_markdown(text.UNCOMPENSATED.format(setting.mark))
        if setting.notes:
            gui.add_markdown(text.noted(setting.notes))
        self.status = gui.add_markdown("")
        self.bar = gui.add_progress_bar(0.0)
        self.layer = gui.add_dropdown("Show", layers.LAYERS, initial_value=layers.MACHINE)
        self.preset = gui.add_dropdown(
            "Preset", tuple(setting.presets), initial_value=setting.config.name
        )
        qualities = (CHOSEN, *QUALITIES)
        self.quality = gui.add_dropdown(
            "Quality", qualities, initial_value=setting.quality or CHOSEN
        )
        own = f"{setting.camera.width}x{setting.camera.height}"
        self.size = gui.add_dropdown("Size", tuple(setting.sizes), initial_value=own)
        for switch in (self.layer, self.preset, self.quality, self.size):
            switch.on_update(lambda _: self.ask())
        cameras = {BEGIN: setting.camera} | {camera.name: camera for camera in setting.cameras}
        self.camera = gui.add_dropdown("Camera", tuple(cameras), initial_value=BEGIN)
        self.camera.on_update(lambda _: self.go(cameras[self.camera.value]))
        keep = gui.add_button("Save camera", hint="A file for --camera")
        keep.on_click(lambda _: self.keep())
        rtl = gui.add_button("Simulate in RTL", hint="The hardware itself; takes minutes")
        rtl.on_click(lambda _: self.ask(layers.RTL))
        self.rtl_text = gui.add_markdown("")
        self.facts = gui.add_markdown("")


def alike(one: Camera, other: Camera) -> bool:
    """Return whether two cameras give equal pictures."""
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in vars(one))
