"""The command line `splatcore`: bad input is one line and exit status 2."""

import sys

from splatcore.sim.cli import bench as bench_command
from splatcore.sim.cli import bench_compression as compression_command
from splatcore.sim.cli import bench_differentiable
from splatcore.sim.cli import campaigns as campaign_command
from splatcore.sim.cli import compress as compress_command
from splatcore.sim.cli import cycles as cycles_command
from splatcore.sim.cli import error as error_command
from splatcore.sim.cli import fit as fit_command
from splatcore.sim.cli import fpga as fpga_command
from splatcore.sim.cli import hard as hard_command
from splatcore.sim.cli import hardware as hardware_commands
from splatcore.sim.cli import image as image_commands
from splatcore.sim.cli import power as power_command
from splatcore.sim.cli import report as report_command
from splatcore.sim.cli import scene as scene_commands
from splatcore.sim.cli.options import app
from splatcore.sim.common.output import messages
from splatcore.spec.error import InputError

ORDER = (
    "scene", "info", "train", "compress", "pack", "render", "compare", "error", "hard", "programs",
    "verilog", "registers", "synth", "fpga", "memories", "cycles", "power", "fit", "bench",
    "report",
)  # fmt: skip
"""The commands as the help lists them: the way of the data."""

COMMANDS = (
    scene_commands, compress_command, image_commands, error_command, hard_command,
    hardware_commands, fpga_command, cycles_command, power_command, fit_command, bench_command,
    bench_differentiable, campaign_command, compression_command, report_command,
)  # fmt: skip
"""Modules whose import has registered their commands with `app`."""

app.registered_commands.sort(key=lambda command: ORDER.index(command.name))


def main(arguments: list[str] | None = None):
    """Run the command line; bad input is one line on standard error and exit status 2."""
    try:
        app(arguments)
    except InputError as error:
        messages.print(f"error: {error}", markup=False, soft_wrap=True)
        sys.exit(2)
    except MemoryError:
        messages.print("error: memory exhausted; a smaller --size needs less", markup=False)
        sys.exit(2)


if __name__ == "__main__":
    main()
