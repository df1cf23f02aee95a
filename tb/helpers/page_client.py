"""A fake of viser's client for `sim.view.page`: a page without a browser."""

from contextlib import nullcontext

import numpy as np
from scipy.spatial.transform import Rotation


class Widget:
    """An element of the page; its attributes are those that it was created with."""

    def __init__(self, **attributes):
        self.actions = []
        vars(self).update(attributes)

    def on_update(self, action):
        self.actions.append(action)

    on_click = on_update

    def change(self, value=None):
        """Simulate a user's choice or click."""
        self.value = value
        for action in self.actions:
            action(None)


class PageCamera:
    """The page's camera, with viser's attributes."""

    def __init__(self, width: int, height: int):
        self.image_width, self.image_height, self.fov = width, height, 1.0
        self.position, self.look_at = np.array([3.0, 3.0, 3.0]), np.zeros(3)
        self.up_direction, self.actions = np.array([0.0, 0.0, 1.0]), []

    @property
    def wxyz(self) -> np.ndarray:
        ahead = np.asarray(self.look_at) - self.position
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, self.up_direction)
        right = right / np.linalg.norm(right)
        columns = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        return Rotation.from_matrix(columns).as_quat(scalar_first=True)

    def on_update(self, action):
        self.actions.append(action)

    def report(self):
        """Simulate the browser's report of the camera's position."""
        for action in self.actions:
            action(self)

    def step(self, way: np.ndarray):
        """Simulate a user who moves the camera."""
        self.position = self.position + way
        self.look_at = self.look_at + way
        self.report()


class PageClient:
    """A page of `width` x `height` pixels.

    background: the picture
    widgets: by label
    files: that were sent, by name
    splats: drawn by the browser
    """

    def __init__(self, width: int, height: int):
        self.camera, self.scene, self.gui = PageCamera(width, height), self, self
        self.background, self.widgets, self.files, self.splats = None, {}, {}, None

    def add_gaussian_splats(self, name: str, **arrays) -> Widget:
        self.splats = Widget(visible=True, **arrays)
        return self.splats

    def set_background_image(self, pixels, format="auto"):
        assert pixels is None or format == "png"
        self.background = pixels

    def add_markdown(self, content: str) -> Widget:
        return self._add(f"text {len(self.widgets)}", content=content)

    def add_progress_bar(self, value: float) -> Widget:
        return self._add("bar", value=value, animated=False)

    def add_dropdown(self, label: str, options, initial_value=None) -> Widget:
        return self._add(label, options=options, value=initial_value or options[0])

    def add_button(self, label: str, hint: str = "") -> Widget:
        return self._add(label, hint=hint)

    def _add(self, label: str, **attributes) -> Widget:
        self.widgets[label] = Widget(**attributes)
        return self.widgets[label]

    def atomic(self):
        return nullcontext()

    def send_file_download(self, name: str, content: bytes):
        self.files[name] = content
