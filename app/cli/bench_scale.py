"""The command `bench scale`: time and memory of commands by the number of Gaussians."""

from pathlib import Path

from splatcore.app.cli.bench import PIXELS, finish
from splatcore.app.cli.options import FOLDER, SCENE, command, option
from splatcore.model.generate.generate import COUNT_MAX
from splatcore.sim.common.choice import numbers_within
from splatcore.sim.common.output import make_folder
from splatcore.sim.frame.size import parse_size
from splatcore.spec.convention import SH_DEGREE_MAX


@command("bench scale")
def scale_command(
    output: Path = option(
        ..., FOLDER, "Folder for scale.json, scale.csv and scale.png.", "-o", "--out"
    ),
    counts: str | None = option(
        None, "N,N,…", "Gaussians of the scenes. Default: 1, 2, 4, 8 and 12 million.", panel=SCENE
    ),
    degrees: str | None = option(
        None, "N,N,…", "SH degrees of the scenes. Default: 1 and 3.", panel=SCENE
    ),
    size: str = PIXELS,
    against: str | None = option(
        None, "DIR", "Also measure another checkout of this repository, in turn; print the ratios."
    ),
    against_most: int | None = option(
        None, "N", "Largest scene of --against, in Gaussians. Default: all scenes."
    ),
):
    """Measure time and memory of commands on scenes of many sizes.

    Generates gardens, and runs info, pack, cycles and render on each, every command in a process of
    its own. Writes CPU and wall seconds and the peak of anonymous memory by number of Gaussians as
    DIR/scale.json, scale.csv and a plot, scale.png. A command that fails is a row with the reason.
    """
    wanted = ("--counts", counts, 1, COUNT_MAX), ("--degrees", degrees, 0, SH_DEGREE_MAX)
    asked = [None if each[1] is None else numbers_within(*each, int) for each in wanted]
    pixels = "x".join(map(str, parse_size(size)))
    from splatcore.study.bench import scale

    chosen = asked[0] or scale.COUNTS, asked[1] or scale.DEGREES
    other = None if against is None else Path(against)
    make_folder(output)
    facts = scale.bench_scale(*chosen, pixels, other, output, against_most)
    scale.table(facts).print()
    scale.needs_table(facts).print()
    finish(output / "scale.json", facts)
