"""The server of the page, using viser."""

import io
import socket
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from importlib.util import find_spec

from splatcore.app.view.camera import level_up, pose_of
from splatcore.app.view.page import Page, Setting
from splatcore.app.view.worker import Worker
from splatcore.sim.frame.reading import Reading
from splatcore.sim.machine.path import target
from splatcore.spec.error import InputError


def check_viser(host: str, port: int):
    """Raise InputError unless viser is installed and can listen here; viser itself would wait."""
    if find_spec("viser") is None:
        raise InputError("view: needs viser: pip install 'splatcore[view]'")
    try:
        socket.create_server((host, port)).close()
    except OSError as error:
        raise InputError(f"--host {host} --port {port}: {error.strerror or error}") from None


@contextmanager
def served(
    scene: str, reading: Reading, setting: Setting, host: str, port: int
) -> Iterator[tuple[str, dict[int, Page]]]:
    """Serve pages of a scene; yield the address, and the open pages by viser's client ID.

    All pages share one worker, which serves the newest request only, and one for RTL simulation.
    scene, reading: arguments of `open_source`
    """
    import viser

    worker, others, pages = Worker(scene, reading), [], {}

    def simulator() -> Worker:
        if not others:
            others.append(Worker(scene, reading))
        return others[0]

    try:
        with quiet():
            server = viser.ViserServer(host, port, label="Splatcore", verbose=False)
        begin(server, setting)

        @server.on_client_connect
        def _(client):
            pages[client.client_id] = Page(client, setting, worker, simulator)

        @server.on_client_disconnect
        def _(client):
            if page := pages.pop(client.client_id, None):
                page.close()

        yield f"http://{host}:{server.get_port()}", pages
        with quiet():
            server.stop()
    finally:
        for each in (worker, *others):
            each.close()


def quiet():
    """Suppress viser's own messages."""
    return redirect_stdout(io.StringIO())


def begin(server, setting: Setting):
    """Set what all pages share: the theme, the scene's up direction and the initial camera."""
    server.gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=True)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction(tuple(setting.up))
    camera, first = setting.camera, server.initial_camera
    first.position = camera.position
    first.look_at = target(camera, setting.drawn.position)
    first.up = level_up(camera, setting.up)
    first.fov = pose_of(camera, (camera.width, camera.height)).fov
