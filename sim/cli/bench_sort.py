"""The command `bench sort`: cycles of sorting, in RTL simulation."""

from pathlib import Path

from splatcore.sim.cli.bench import bench
from splatcore.sim.cli.options import JsonOption, PresetOption, option
from splatcore.sim.common.output import console, write_json
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

LENGTH_MAX = 1_000_000  # longest list that can be asked for: more than a frame has in a group


OutputOption = option(Path, "DIR", "Folder for sort.png.", "-o")
LengthsOption = option(str | None, "N,N,…", "Entries of the lists. Default: 1 to 20,000.")


@bench.command("sort")
def sort_command(
    output: OutputOption,
    preset: PresetOption = "DEFAULT",
    lengths: LengthsOption = None,
    json: JsonOption = None,
):
    """Sort lists of random, equal, sorted, reversed and clustered keys with stage 2 in RTL.

    Prints cycles from the first entry of a list to the mark behind it, by length and kind of keys,
    beside those of the cycle model, and draws them in DIR/sort.png. All that comes out is compared
    with the golden model.
    """
    config = find_preset(preset)
    asked = None if lengths is None else parse_lengths(lengths)
    from splatcore.sim.bench.sort import LENGTHS, bench_sort

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
    """Numbers with commas between them; InputError for anything else."""
    try:
        lengths = tuple(map(int, text.split(",")))
    except ValueError:
        raise InputError(f"--lengths '{text}': are not numbers with commas between them") from None
    if not all(1 <= length <= LENGTH_MAX for length in lengths):
        raise InputError(f"--lengths '{text}': are not all in 1 … {LENGTH_MAX}")
    return lengths
