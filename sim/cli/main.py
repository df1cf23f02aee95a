"""The command line `splatcore`: bad input is one line and exit status 2."""

import sys
from importlib import import_module

import typer

from splatcore.sim.cli.bench import bench
from splatcore.sim.cli.board import board
from splatcore.sim.cli.options import app
from splatcore.sim.cli.soak import soak
from splatcore.sim.common import notes
from splatcore.sim.common.output import messages
from splatcore.spec.error import InputError

UsageError = typer.BadParameter.__mro__[1]  # of click, or of typer's own copy of it

COMMANDS = {
    "scene": ("scene", "Generate a scene and write it as a 3DGS PLY."),
    "join": ("scene", "Put scenes side by side in front of one camera."),
    "info": ("scene", "Say what a scene or packed model holds."),
    "photographs": ("photographs", "Photograph a scene: pictures, poses and points."),
    "train": ("compress", "Train a plain 3DGS scene from photographs."),
    "compress": ("compress", "Compress a scene."),
    "pack": ("pack", "Pack a scene into the model that the machine reads."),
    "render": ("render", "Render one frame and count the work in it."),
    "view": (
        "view",
        "Look at a scene in the browser, with the machine's picture at rest.",
    ),
    "compare": ("compare", "PSNR, SSIM and maximum error of images against the first one."),
    "error": ("error", "Error of the numbers of stages 0 and 1."),
    "hard": ("hard", "Run the hard cases through an engine."),
    "programs": ("programs", "List the microprograms of stages 0 and 1."),
    "verilog": ("verilog", "Write the machine as Verilog."),
    "registers": ("verilog", "Write the register map."),
    "example": ("example", "Write a folder that stands alone: Verilog, and a frame of it."),
    "synth": ("synth", "Synthesise stages or primitives and say how large and how deep they are."),
    "fpga": ("sizes", "Place and route parts on a Lattice ECP5, each on its own."),
    "memories": ("sizes", "List the on-chip memories of each stage, beside the paper's five."),
    "cycles": ("cycles", "Cycles of a frame by stage, and the error of its picture."),
    "power": ("power", "ESTIMATE the power of a frame, first order, by stage."),
    "fit": ("fit", "Choose the smallest machine that renders a scene fast and well enough."),
    "report": ("report", "Write one page that says how fast, how exact and how large it is."),
    "coverage": ("coverage", "Say which branches and lines of hdl/ simulations have reached."),
    "cache": ("cache", "Say what is kept of long work, and how large it is; remove it."),
    "bench sort": ("bench_sort", "Sort lists of keys with stage 2 in RTL."),
    "bench scenes": ("bench_views", "Render scenes by the simulated machine."),
    "bench sweep": ("bench_views", "Speed against error and gates: many machines, many scenes."),
    "bench ablation": ("bench_views", "Gain of culling, zero skipping and early termination."),
    "bench work": ("bench_views", "Work of scenes for the machine by every camera."),
    "bench rule": ("bench_rule", "Rules for what is too faint to be seen."),
    "bench quality": (
        "bench_quality",
        "Bytes a Gaussian against dB.",
    ),
    "bench formats": ("bench_formats", "Bytes against dB of other formats, beside our models."),
    "bench coding": ("bench_coding", "Bytes of model files by the way of coding."),
    "bench compression": ("bench_compression", "Compress scenes and measure."),
    "bench differentiable": ("bench_differentiable", "Time the differentiable renderer."),
    "board write": ("board_runs", "Write a ULX3S's files: Verilog, pins, a Makefile."),
    "board render": ("board_runs", "Render a frame by a board."),
    "soak frames": ("soak_runs", "Render random small scenes in RTL, against the golden model."),
    "soak faults": ("soak_runs", "Let things go wrong in RTL: errors are told, nothing hangs."),
}
"""Commands in help's order: the file of this folder whose import registers each, what it does."""

GROUPS = {"bench": bench, "board": board, "soak": soak}
"""Groups of commands, those of a first word."""


def register(words: list[str] | None = None):
    """Import the file of the command that words begin with; of all commands without words.

    Words that name none want help, or are wrong: names are enough, and a tenth of the time.
    """
    name = " ".join((words or [])[: 2 if words and words[0] in GROUPS else 1])
    if words is None or name in COMMANDS:
        for each in [name] if name else COMMANDS:
            import_module(f"splatcore.sim.cli.{COMMANDS[each][0]}")
        return
    for name, (_, does) in COMMANDS.items():
        group, _, last = name.rpartition(" ")
        GROUPS.get(group, app).command(last, help=does)(lambda: None)


def main(arguments: list[str] | None = None):
    """Run the command line; bad input is one line on standard error and exit status 2."""
    register(sys.argv[1:] if arguments is None else None)
    try:
        with notes.printed():
            status = app(arguments, standalone_mode=False)
    except InputError as error:
        refuse(str(error))
    except UsageError as error:
        refuse(usage(error))
    except MemoryError:
        refuse("memory exhausted; a smaller --size needs less")
    sys.exit(status or 0)


def refuse(text: str):
    """End with a line of error, if there is one to say, and status 2."""
    if text:
        messages.print(f"error: {text}", markup=False, soft_wrap=True)
    sys.exit(2)


def usage(error: UsageError) -> str:
    """What is wrong with the arguments, and whose help tells more; nothing if help was shown."""
    text = " ".join(error.format_message().removeprefix("Invalid value for ").split()).rstrip(".")
    return text and f"{text}; see {error.ctx.command_path} --help" if error.ctx else text


if __name__ == "__main__":
    main()
