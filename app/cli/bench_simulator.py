"""The command `bench simulator`: CPU time of building and of simulating a machine in RTL."""

from pathlib import Path

from splatcore.app.cli import options
from splatcore.app.cli.bench import PIXELS
from splatcore.app.cli.options import command, option
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.size import parse_size
from splatcore.spec.config import Config


@command("bench simulator")
def simulator_command(
    reading: Reading,
    scene: str = options.SOURCE,
    size: str = PIXELS,
    config: Config = options.PRESET,
    against: str | None = option(
        None, "DIR", "Also measure another checkout of this repository, in turn; print the ratios."
    ),
) -> dict:
    """Measure CPU seconds of building and of simulating in RTL.

    Each command runs in a process of its own, with an empty cache: first a program is built, then a
    frame is simulated three times. The golden model and comparisons are left out.
    """
    pixels = "x".join(map(str, parse_size(size)))
    from splatcore.study.bench import simulator

    other = None if against is None else Path(against)
    scene = str(Path(scene).absolute()) if Path(scene).exists() else scene  # runs in other folders
    found = simulator.bench_simulator(config.name, scene, reading, pixels, other)
    simulator.table(found).print()
    return found
