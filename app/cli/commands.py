"""All commands: the file that defines each, its purpose, its summary and an example."""

from typing import NamedTuple

LOOK = "Look at a scene"
PACK = "Pack a scene"
RENDER = "Render"
MEASURE = "Measure"
HARDWARE = "Hardware"
FPGA = "FPGA"
COMPRESS = "Compression"
REPORT = "Report and cache"

PURPOSES = (LOOK, PACK, RENDER, MEASURE, HARDWARE, FPGA, COMPRESS, REPORT)
"""Headings of the commands in `splatcore --help` and docs/commands.md, in their order."""


class Entry(NamedTuple):
    """A command.

    file: module of this package whose import registers the command
    purpose: one of `PURPOSES`
    summary: first line of its help
    arguments: words after `splatcore NAME` in the example
    """

    file: str
    purpose: str
    summary: str
    arguments: str = ""


COMMANDS = {
    "scene": Entry(
        "scene", LOOK, "Generate a scene and write it as a 3DGS PLY file.",
        "garden -o garden.ply --cameras garden.cameras.json",
    ),
    "join": Entry(
        "scene", LOOK, "Put scenes side by side in front of one camera, in one PLY file.",
        "garden needles -o both.ply",
    ),
    "info": Entry("scene", LOOK, "Show the contents of a scene or packed model.", "garden"),
    "view": Entry(
        "view", LOOK, "Look at a scene in the browser, as the machine renders it.",
        "garden --browser",
    ),
    "pack": Entry(
        "pack", PACK, "Pack a scene into a model for the machine, and measure the loss.",
        "garden -o garden.splatcore",
    ),
    "export": Entry(
        "export", PACK, "Write a scene or packed model as a scene file for other tools.",
        "garden -o garden.spz --size 640x360",
    ),
    "render": Entry(
        "render", RENDER, "Render a picture, or one per camera, and count the work in it.",
        "garden --engine golden -o garden.png",
    ),
    "simulate": Entry(
        "simulate", RENDER, "Simulate the hardware in RTL: pictures, cycles, waveforms.",
        "garden --preset tiny --size 64x64 -o rtl.png",
    ),
    "compare": Entry(
        "compare", RENDER, "Compare images with the first one: PSNR, SSIM and maximum error.",
        "reference golden --scene garden --size 640x360",
    ),
    "hard": Entry(
        "hard", RENDER, "Run the hard cases: small scenes on which renderers go wrong.",
        "needles --engine golden -o hard",
    ),
    "cycles": Entry(
        "cycles", MEASURE, "Estimate a frame's cycles by stage, and measure its error.",
        "garden --size 1280x720",
    ),
    "error": Entry(
        "error", MEASURE, "Measure the error of the machine's numbers, stage by stage.",
        "garden --stage all --size 640x360",
    ),
    "power": Entry(
        "power", MEASURE, "ESTIMATE the power of a frame by stage, to first order.",
        "garden --preset tiny --size 64x64",
    ),
    "fit": Entry(
        "fit", MEASURE, "Find the smallest machine that renders a scene fast and well enough.",
        "garden --fps 200 --size 640x360 -o fitted.toml",
    ),
    "verilog": Entry(
        "verilog", HARDWARE, "Write the machine as Verilog, with the files that a flow needs.",
        "-o verilog",
    ),
    "registers": Entry(
        "verilog", HARDWARE, "Write the register map, a C header, a driver and SystemRDL.",
        "-o registers",
    ),
    "example": Entry(
        "verilog", HARDWARE, "Write a self-contained folder in which Verilog renders a frame.",
        "-o example",
    ),
    "synth": Entry(
        "synth", HARDWARE, "Synthesise stages or primitives; print their size and depth.",
        "--stage cull --stage raster",
    ),
    "fpga": Entry(
        "sizes", FPGA, "Place and route parts, or the whole machine, on a Lattice ECP5.",
        "--stage cull",
    ),
    "memories": Entry(
        "sizes", HARDWARE,
        "List the on-chip memories of each stage, and of Chang and Chang's paper.",
        "--preset tiny",
    ),
    "coverage": Entry(
        "coverage", HARDWARE, "Show which branches and lines of hdl/ simulations have reached.",
        "out/coverage",
    ),
    "photographs": Entry(
        "photographs", COMPRESS, "Render a scene as photographs: pictures, poses and points.",
        "garden -o photos --views 20 --size 640x360",
    ),
    "train": Entry(
        "compress", COMPRESS, "Train a plain 3DGS scene from photographs.",
        "photos -o trained.ply --steps 1000",
    ),
    "compress": Entry(
        "compress", COMPRESS, "Compress a scene into a small packed model.",
        "garden -o small.splatcore --target-ratio 30",
    ),
    "report": Entry(
        "report", REPORT, "Write one page of results: the machine's speed, error and size.",
        "-o report",
    ),
    "cache": Entry(
        "cache", REPORT, "Show or clear the cache of compiled machines and synthesis results."
    ),
    "bench sort": Entry(
        "bench", MEASURE, "Measure the cycles of sorting, with stage 2 simulated in RTL.",
        "-o sort --preset tiny --lengths 100,1000",
    ),
    "bench scenes": Entry(
        "bench", MEASURE, "Render scenes in RTL: cycles, memory traffic, correctness.",
        "garden -o scenes --preset tiny --size 64x64",
    ),
    "bench sweep": Entry(
        "bench", MEASURE, "Compare many machines on many scenes: speed, error, gates.",
        "garden -o sweep --size 640x360",
    ),
    "bench ablation": Entry(
        "bench", MEASURE, "Measure the gain of culling, zero skipping and early termination.",
        "garden -o ablation --size 640x360",
    ),
    "bench rule": Entry(
        "bench", MEASURE, "Compare faintness rules: cycles of stage 3 against error.",
        "garden -o rule --size 640x360",
    ),
    "bench quality": Entry(
        "bench", MEASURE, "Measure bytes per Gaussian against dB for each way to pack.",
        "garden -o quality --size 640x360",
    ),
    "bench scale": Entry(
        "bench_scale", MEASURE, "Measure time and memory of commands on scenes of many sizes.",
        "-o scale --counts 20000,40000 --degrees 1",
    ),
    "bench levels": Entry(
        "bench_levels", MEASURE, "Measure cycles and dB of a scene with levels of detail.",
        "garden -o levels --quality compact",
    ),
    "bench simulator": Entry(
        "bench_simulator", MEASURE, "Measure CPU seconds of building and of simulating in RTL.",
        "garden --size 640x360",
    ),
    "bench compression": Entry(
        "bench_compression", COMPRESS, "Compress scenes; measure size, loss and machine work.",
        "garden -o out --part steps --steps 40",
    ),
    "board write": Entry(
        "board", FPGA, "Write the files for a ULX3S board: Verilog, pins and a Makefile.",
        "-o ulx",
    ),
    "board render": Entry(
        "board", FPGA, "Render a frame on a board and compare it with the golden model.",
        "garden --board ulx --port /dev/ttyS0 -o a.png",
    ),
    "soak frames": Entry(
        "soak", HARDWARE, "Render random small scenes in RTL, against the golden model.",
        "-o soak --count 40",
    ),
    "soak faults": Entry(
        "soak", HARDWARE, "Inject random faults in RTL: each must be reported, none may hang.",
        "-o soak --count 20",
    ),
}  # fmt: skip
"""Commands by name, in the order of the help."""

SIMULATE = "`splatcore simulate` has it"
RECIPE = "set `{}` in a TOML file for --recipe"

GONE = (
    {
        f"render --{name}": SIMULATE
        for name in "frames timing error-map waves window tile scope waves-max".split()
    }
    | {
        f"compress --{name.replace('_', '-')}": RECIPE.format(name)
        for name in "schedule steps distill_steps quantize_steps rate order degree quality seed "
        "views beside scale hold_out".split()
    }
    | {
        "bench work": "its results are in docs/notes/2026-11-paper.md",
        "bench formats": "its results are in docs/notes/2026-11-compression.md",
        "bench coding": "its results are in docs/notes/2026-11-compression.md",
        "bench differentiable": "its result is in docs/notes/2026-11-compression.md",
        "programs": "spec/programs.py has the microprograms, `splatcore report` their operations",
    }
)
"""Commands and options of earlier versions, and what to use instead."""


class Group(NamedTuple):
    """A group of commands. example: the command whose example its help shows"""

    purpose: str
    example: str
    help: str


GROUPS = {
    "bench": Group(MEASURE, "bench scenes", "Measure many scenes or machines in one run."),
    "board": Group(FPGA, "board write", "Build the machine for an FPGA board and use it."),
    "soak": Group(
        HARDWARE, "soak frames", "Random frames and faults in RTL, against the golden model."
    ),
}
"""Groups of commands, by the first word of their commands."""


def example(name: str) -> str:
    """Return the example of a command, group, or "" (the program) as a command line."""
    name = GROUPS[name].example if name in GROUPS else name or "render"
    return f"splatcore {name} {COMMANDS[name].arguments}".strip()
