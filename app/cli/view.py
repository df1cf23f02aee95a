"""The command `view`: a page in the browser with the machine's picture of the current view."""

from splatcore.app.cli import describe, options
from splatcore.app.cli.options import option
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.frame.size import parse_size
from splatcore.sim.frame.source import (
    Source,
    camera_beside,
    check_fits,
    open_camera,
    open_cameras,
    open_source,
)
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

AT_MOST = (960, 540)
"""Maximum size of a picture without --size: it renders in a second or two."""

SERVER = "Server"


@options.command("view")
def view_command(
    view: options.Viewing,
    scene: str = options.SOURCE,
    config: Config = options.PRESET,
    quality: str | None = options.QUALITY,
    host: str = option(
        "127.0.0.1",
        "ADDRESS",
        "Address to listen on; 0.0.0.0: also for other computers.",
        panel=SERVER,
    ),
    port: int = option(8080, "N", "Port; 0: any free one.", min=0, max=65535, panel=SERVER),
    browser: bool = option(
        False,
        None,
        "Open the page in the browser of this computer.",
        "--browser/--no-browser",
        panel=SERVER,
    ),
):
    """Look at a scene in the browser, as the machine renders it.

    While the camera moves, the browser draws the splats itself; when it rests, the page shows the
    golden model's picture, with cycles, frames per second and error. It can also show the
    reference's picture, error maps, splats per tile or cycles per group. Needs the extra `view`.
    """
    from splatcore.app.view.server import check_viser, served

    options.check_quality(quality, scene)
    if view.size:
        check_fits(config, *parse_size(view.size))
    check_viser(host, port)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, view.reading)
        setting = setting_of(source, view.camera, view.size, config, quality)
    mark = describe.antialiased_line(source)
    del source  # the workers read the scene themselves
    with served(scene, view.reading, setting, host, port) as (address, _):
        console.print(f"{scene}: {address} (Ctrl-C ends); {mark}")
        wait(address if browser else None)


def setting_of(
    source: Source, camera: str | None, size: str | None, config: Config, quality: str | None
):
    """Return the settings of a new page; raise InputError for a scene that cannot be shown."""
    from splatcore.app.view.camera import fitting, up_of, within
    from splatcore.app.view.drawn import drawn_by_browser
    from splatcore.app.view.page import Setting
    from splatcore.model.formats.camera_file import read_cameras, split_id
    from splatcore.model.pack.pack import qualities_of

    if not len(source.gaussians):
        raise InputError(f"{source.name}: has no Gaussians")
    if quality and quality not in (known := qualities_of(config)):
        kinds = ", ".join(known)
        raise InputError(f"--quality {quality}: preset {config.name} renders {kinds} models only")
    if size:
        (view,) = open_cameras(camera, None, size, source)
    else:
        view = open_camera(camera, size, source, resized=False)
        source.seen_by(view)
        view = view.resized(*fitting(config, within((view.width, view.height), AT_MOST)))
    file = split_id(camera)[0] if camera else camera_beside(source.name)
    cameras = read_cameras(file, size=(view.width, view.height)) if file else []
    cameras = source.reading.seen(cameras)
    up, mark = up_of(cameras or [view]), source.stated["antialiased_by"]
    notes = tuple(source.notes)
    drawn = drawn_by_browser(source.gaussians)
    antialiased = source.stated["antialiased"]
    return Setting(view, cameras, up, config, quality, drawn, antialiased, mark, notes)


def wait(address: str | None):
    """Wait for an interrupt.

    address: page to open in the browser first
    """
    import threading
    import webbrowser

    if address:
        webbrowser.open(address)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        console.print("ended")
