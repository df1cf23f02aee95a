"""The commands `board write` and `board render`: files for a ULX3S, and a frame from a board."""

import time
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

from splatcore.app.cli import options
from splatcore.app.cli.background import Background
from splatcore.app.cli.options import option
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.frame.metric import against, metrics_line
from splatcore.sim.frame.picture import write_png
from splatcore.sim.frame.shot import judge
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

SDRAMS = {"32": "MT48LC16M16", "64": "AS4C32M16"}
"""SDRAM chips of ULX3S boards by size in megabytes."""

LIBRARIES = ("litex", "litedram", "litex_boards")

BOARD = "Board"


def check_libraries():
    """Raise InputError unless the libraries of the extra [board] are installed."""
    for name in LIBRARIES:
        if find_spec(name) is None:
            raise InputError(f"board: needs {name}: pip install 'splatcore[board]'")


@options.command("board write")
def write_command(
    output: Path = options.NEW_FOLDER,
    preset: str = option(
        "FPGA", "NAME|FILE", "Machine: a preset or a TOML file.", panel=options.MACHINE
    ),
    clock: float = option(50.0, "MHZ", "Clock of machine and SDRAM.", min=1, max=133, panel=BOARD),
    baud: int = option(
        1_000_000, "N", "UART rate in bits per second.", min=9600, max=3_000_000, panel=BOARD
    ),
    sdram: str = option("32", "MB", f"Size of the SDRAM: {', '.join(SDRAMS)} MB.", panel=BOARD),
):
    """Write the files for a ULX3S board: Verilog, pins and a Makefile.

    For a ULX3S with an LFE5U-85F. The machine is part of a LiteX system with an SDRAM controller
    (LiteDRAM) and a UART, through which `board render` accesses memory and registers. `make` in the
    folder builds the bitstream with yosys and nextpnr from PyPI; see README.md there.
    """
    check_known("--sdram", SDRAMS, sdram)
    config = find_preset(preset)
    check_libraries()
    from splatcore.eda.board.write import write_board

    with progress_bar("writing the board"):
        paths = write_board(output, config, round(clock * 1e6), baud, SDRAMS[sdram])
    for path in paths:
        console.print(str(path))


@options.command("board render")
def render_command(
    view: options.Viewing,
    background: Background,
    scene: str = options.SOURCE,
    output: Path = option(..., "OUT.png", "Picture to write."),
    board: str = option(..., "DIR", "Folder written by `board write`.", panel=BOARD),
    port: str = option(..., "DEVICE", "Serial port, like /dev/ttyUSB0.", panel=BOARD),
) -> dict:
    """Render a frame on a board and compare it with the golden model.

    Model and picture are sent over a serial port. Exit status 1 if a pixel differs.
    """
    check_libraries()
    from splatcore.eda.board.host import Host, read_board

    config, facts = read_board(board)
    shot = view.open(scene, **background.shot(config, "rtl"))
    shot.check_fits()
    from splatcore.sim.frame import engines

    with closing(Host(port, config, facts)) as host:
        job = shot.job
        host.begin()
        begin = time.perf_counter()
        with progress_bar("loading the model") as advance:
            frame = host.frame(job, advance)
        seconds = time.perf_counter() - begin
    write_png(output, frame.pixels)
    golden = engines.golden(shot)
    note_empty(shot, golden.counts)
    wrong, clock = int((frame.pixels != golden.pixels).any(2).sum()), facts["clock_hz"]
    found = judge(frame, shot)
    rate = clock / max(frame.preprocessing, frame.rendering)
    same = f"{wrong} pixels differ from" if wrong else "identical to"
    text = f"{output}: {same} the golden model; against the reference: {metrics_line(found)}"
    console.print(text)
    console.print(
        f"{frame.preprocessing} cycles of preprocessing, {frame.rendering} of rendering: "
        f"{rate:.1f} frames per second at {clock / 1e6:g} MHz; {seconds:.1f} s with all transfers"
    )
    facts_written = {
        "scene": scene, "preset": config.name, "size": list(shot.size),
        "clock_hz": clock, "preprocessing_cycles": frame.preprocessing,
        "rendering_cycles": frame.rendering, "frames_a_second": round(rate, 3),
        "seconds": round(seconds, 3), "identical": not wrong, **shot.source.stated,
    }  # fmt: skip
    return options.result(facts_written | against(found), wrong)
