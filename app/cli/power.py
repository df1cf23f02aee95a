"""The command `power`: an ESTIMATE of a frame's power by stage, compared with the paper's."""

from pathlib import Path

from splatcore.app.cli import options
from splatcore.app.cli.options import option
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.sim.common.output import console, progress_bar
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.energy import PROCESS_NM, Energy
from splatcore.spec.error import InputError

CELLS = "Standard cells"

LIBERTY = option(
    None,
    "FILE",
    "Take the energies of gates from a library (.lib, .lib.gz); needs --process.",
    panel=CELLS,
)
PROCESS = option(
    None, "NM", f"Process of the library, for scaling to {PROCESS_NM} nm.", min=1.0, panel=CELLS
)


@options.command("power")
def power_command(
    view: options.Viewing,
    scene: str = options.SOURCE,
    config: Config = options.PRESET,
    fps: float | None = option(None, "N", "Frames per second. Default: full speed at 800 MHz."),
    sample: int | None = option(
        None,
        "N",
        "Count net changes in one of N windows of cycles; 1: in all. Default: about 128 windows.",
    ),
    toggles: bool = option(
        False, None, "Also list the 20 registers and memories that take the most power."
    ),
    liberty: str | None = LIBERTY,
    process: float | None = PROCESS,
) -> dict:
    """ESTIMATE the power of a frame by stage, to first order.

    Simulates frames in RTL. The energy of a part is the mean rate of changes of its RTL nets, times
    its gates, times the energy of a switching NAND2; flip-flops add their clock, as far as their
    clock gate is open, memories their accesses, DRAM (listed apart) its bytes. Nothing is laid out.
    Constants for 28 nm at 0.9 V and their sources are in spec/energy.py. Accuracy: a factor of two
    either way.

    With --liberty the energies of gates and flip-flops come from the library, by slew and load with
    wires, scaled from --process and its voltage.

    The first run for DEFAULT takes half an hour (simulation and synthesis); results are cached (see
    `splatcore cache`).
    """
    library = _checked(fps, sample, liberty, process)
    shot = view.open(scene, config=config)
    shot.check_fits()
    from splatcore.eda.power.activity import counts_of
    from splatcore.eda.power.cells import machine_gates
    from splatcore.eda.power.clocks import clocked
    from splatcore.eda.power.estimate import estimate
    from splatcore.eda.power.tables import costs, lines, report, table

    source = shot.source
    counts = counts_of(config, shot.job, sample, f"simulating {source.name}")
    if fps is not None and fps > (fps_max := CLOCK_HZ / counts.cycles):
        raise InputError(f"--fps {fps:g}: is above {fps_max:.1f}, the maximum at 800 MHz")
    with progress_bar("synthesising the machine") as advance:
        gates = machine_gates(config, library, process, advance)
        clocks = clocked(config, counts.registers)
    found = estimate(counts, gates, clocks, config.energy)
    fps = found.fps_max if fps is None else fps
    frame = f"{Path(source.name).name} {'x'.join(map(str, shot.size))}, preset {config.name}"
    table(found, fps, f"ESTIMATE, first order: {frame}, {fps:.1f} frames per second").print()
    for text in lines(found, fps):
        console.print(text)
    costly = costs(found, counts, config.energy, fps) if toggles else {}
    facts = {
        "preset": config.name, "scene": source.name, "camera": view.camera or shot.camera.name,
        "size": list(shot.size), **source.stated,
    }  # fmt: skip
    if library:
        facts["liberty"] = _cells(library, process, config.energy)
    return facts | report(found, counts, config.energy, fps) | costly


def _checked(
    fps: float | None, sample: int | None, liberty: str | None, process: float | None
) -> Library | None:
    """Check the options; return the library of --liberty, if given."""
    for name, value in (("fps", fps), ("sample", sample)):
        if value is not None and not value > 0:
            raise InputError(f"--{name} {value:g}: must be above 0")
    return checked_library(liberty, process)


def checked_library(liberty: str | None, process: float | None) -> Library | None:
    """Read the library, if given; raise InputError for --liberty without --process or inverse."""
    if (liberty is None) != (process is None):
        given, other = ("--process", "--liberty")[:: -1 if process is None else 1]
        raise InputError(f"{given} {process or liberty}: goes with {other} only")
    return liberty and read_liberty(liberty)


def _cells(library: Library, process: float, energy: Energy) -> dict:
    """Print the library that was used; return its facts for JSON."""
    volts = library.voltage
    text = f"In cells of {library.name}, scaled from {process:g} nm, {volts:g} V."
    console.print(text)
    return {
        "library": library.name, "corner": library.corner, "voltage": volts,
        "process_nm": process, "scale": energy.scale(process, volts),
    }  # fmt: skip
