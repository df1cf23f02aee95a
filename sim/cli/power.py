"""The command `power`: an ESTIMATE of what a frame takes, stage by stage, beside the paper's."""

from pathlib import Path

from splatcore.sim.cli import options
from splatcore.sim.cli.options import option
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.reading import Reading
from splatcore.sim.common.source import check_fits, open_cameras, open_source
from splatcore.sim.common.table import print_whole
from splatcore.sim.eda.liberty import Library
from splatcore.sim.eda.liberty_file import read_liberty
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.energy import PROCESS_NM, Energy
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

FpsOption = option(float | None, "N", "Frames a second. Default: full speed, 800 MHz.", "--fps")
SampleOption = option(
    int | None,
    "N",
    "Count in one of N windows of cycles; 1: in all. Default: about 32 windows.",
    "--sample",
)
LibertyOption = option(
    str | None, "FILE", "Standard cells (.lib, .lib.gz): gates' energies by these, with --process."
)
ProcessOption = option(
    float | None, "NM", f"The library's process, to scale energies to {PROCESS_NM} nm.", min=1.0
)


@options.app.command("power")
def power_command(
    scene: options.SourceArgument,
    camera: options.CameraOption = None,
    size: options.SizeOption = None,
    antialiased: options.AntialiasedOption = None,
    axes: options.AxesOption = None,
    near: options.NearOption = None,
    preset: options.PresetOption = "DEFAULT",
    fps: FpsOption = None,
    sample: SampleOption = None,
    liberty: LibertyOption = None,
    process: ProcessOption = None,
    json: options.JsonOption = None,
):  # fmt: skip
    """ESTIMATE the power of a frame, first order, by stage, beside the paper's.

    Frames are simulated in RTL; how often the nets of a part change, times its gates, times the
    energy of a NAND2 that switches, is the part's. Nets of RTL stand for those of gates; nothing
    is laid out. Flip-flops add their clock, memories their accesses, DRAM (apart) its bytes. All
    constants are in spec/energy.py, 28 nm at 0.9 V, with their sources; --json writes them, too.
    Good to a factor of two either way.

    With --liberty each gate and flip-flop takes what the library says, by its slew and load, wires
    included, scaled from --process and the library's voltage; memories, DRAM and leakage as before.

    The first time it compiles and simulates the machine and synthesises its parts, half an hour
    for DEFAULT; what it finds is kept (see `splatcore cache`).
    """
    config = find_preset(preset)
    library = _checked(fps, sample, liberty, process)
    with progress_bar(f"packing {scene}"):
        source = open_source(scene, Reading(antialiased, axes, near))
        (view,) = open_cameras(camera, None, size, source)
        check_fits(config, view.width, view.height)
        from splatcore.sim.machine.machine import Job
        from splatcore.sim.packing.choose import packed_model
        from splatcore.sim.power.activity import counts_of
        from splatcore.sim.power.cells import machine_gates
        from splatcore.sim.power.estimate import estimate
        from splatcore.sim.power.tables import lines, report, table

        model = packed_model(source, config, view)
    counts = counts_of(config, Job(model, view), sample, f"simulating {source.name}")
    if fps is not None and fps > (most := CLOCK_HZ / counts.cycles):
        raise InputError(f"--fps {fps:g}: is more than {most:.1f}, what 800 MHz are good for")
    with progress_bar("synthesising the machine") as advance:
        gates = machine_gates(config, library, process, advance)
    found = estimate(counts, gates, config.energy)
    fps = found.fps_max if fps is None else fps
    what = f"{Path(source.name).name} {view.width}x{view.height}, preset {config.name}"
    print_whole(table(found, fps, f"ESTIMATE, first order: {what}, {fps:.1f} frames a second"))
    for text in lines(found, fps):
        console.print(text, soft_wrap=True)
    facts = {
        "preset": config.name, "scene": source.name, "camera": camera or view.name,
        "size": [view.width, view.height], **source.stated,
    }  # fmt: skip
    if library:
        facts["liberty"] = _cells(library, process, config.energy)
    write_json(json, facts | report(found, counts, config.energy, fps))


def _checked(
    fps: float | None, sample: int | None, liberty: str | None, process: float | None
) -> Library | None:
    """The library of a file, if there is one; InputError for options that cannot be."""
    for name, value in (("fps", fps), ("sample", sample)):
        if value is not None and not value > 0:
            raise InputError(f"--{name} {value:g}: is not above 0")
    return checked_library(liberty, process)


def checked_library(liberty: str | None, process: float | None) -> Library | None:
    """The library of a file, if there is one; InputError for --liberty without --process."""
    if (liberty is None) != (process is None):
        given, other = ("--process", "--liberty")[:: -1 if process is None else 1]
        raise InputError(f"{given} {process or liberty}: goes with {other} only")
    return liberty and read_liberty(liberty)


def _cells(library: Library, process: float, energy: Energy) -> dict:
    """Say in which cells it is; the same for a JSON file."""
    volts = library.voltage
    text = f"In cells of {library.name}, scaled from {process:g} nm, {volts:g} V."
    console.print(text, soft_wrap=True)
    return {
        "library": library.name, "corner": library.corner, "voltage": volts,
        "process_nm": process, "scale": energy.scale(process, volts),
    }  # fmt: skip
