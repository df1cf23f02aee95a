"""The command `bench sort`: cycles of sorting in RTL simulation."""

from pathlib import Path

from splatcore.app.cli.bench import bench
from splatcore.app.cli.options import OUTPUT, JsonOption, PresetOption, option
from splatcore.sim.common.output import console, write_json
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

LENGTH_MAX = 1_000_000  # upper limit of --lengths: more entries than a frame has in a group


OutputOption = option(Path, "DIR", "Folder for sort.png.", "-o", panel=OUTPUT)
LengthsOption = option(str | None, "N,N,…", "Entries per list. Default: 1 to 20,000.")


@bench.command("sort")
def sort_command(
    output: OutputOption,
    preset: PresetOption = "DEFAULT",
    lengths: LengthsOption = None,
    json: JsonOption = None,
):
    """Measure the cycles of sorting, with stage 2 simulated in RTL.

    Sorts lists of random, equal, sorted, reversed and clustered keys. Prints the cycles from the
    first entry to the end mark of a list, simulated and by the cycle model, and plots them in
    DIR/sort.png. The sorted lists are compared with the golden model's.
    """
    config = find_preset(preset)
    asked = None if lengths is None else parse_lengths(lengths)
    from splatcore.study.bench.sort import LENGTHS, bench_sort

    counts = asked or LENGTHS
    output.mkdir(exist_ok=True)
    path = output / "sort.png"
    found, model = bench_sort(config, counts, path)
    console.print(str(path), soft_wrap=True)
    facts = {
        "preset": config.name,
        "lengths": list(counts),
        "cycles": found,
        "model": model,
    }
    write_json(json, facts)


def parse_lengths(text: str) -> tuple[int, ...]:
    """Parse numbers separated by commas; raise InputError for anything else."""
    try:
        lengths = tuple(map(int, text.split(",")))
    except ValueError:
        raise InputError(f"--lengths '{text}': must be numbers separated by commas") from None
    if not all(1 <= length <= LENGTH_MAX for length in lengths):
        raise InputError(f"--lengths '{text}': must all be in 1 … {LENGTH_MAX}")
    return lengths
