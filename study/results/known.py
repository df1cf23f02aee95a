"""All results that the report shows: the file, command and fields of each, and what follows."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from splatcore.study.results import campaigns, compression, frames, levels, machines, scale

VARIABLES = ("SCENES", "SIZE", "PRESET", "POINTS")
"""Variables of make on which a result may depend."""


@dataclass(frozen=True)
class Result:
    """A result.

    name: of its tables in docs/results
    file: in the folder of results
    command: words after `splatcore`, with variables of the Makefile
    schema: dataclass of its object
    several: pattern of the JSON files that are its rows, beside `file`
    pictures: files beside it that are kept, too
    hours: takes hours, so `make results` leaves it out
    title, about: of its section in the report, which shows its tables; empty if a section of
        `report.sections` shows it
    """

    name: str
    file: str
    command: str
    schema: type
    several: str = ""
    pictures: tuple[str, ...] = ()
    hours: bool = False
    title: str = ""
    about: str = ""

    @property
    def takes(self) -> tuple[str, ...]:
        """The variables of make that its command uses."""
        used = {name.upper() for name in re.findall(r"\$\((\w+)\)", self.command)}
        return tuple(name for name in VARIABLES if {name, name.removesuffix("S")} & used)

    @property
    def rule(self) -> str:
        """Its rule for make."""
        return f"$(RESULTS)/{self.file}: ; $(measure) {self.command}"


def hard(name: str, options: str, **more) -> Result:
    """The hard cases on a machine."""
    command = f"hard --engine {options.format('-o $(@D) --json $@')}"
    return Result(name, f"{name}/hard.json", command, frames.Hard, **more)


ALL = "$(SCENES) $(size) $(preset)"

RESULTS = {
    each.name: each
    for each in (
        Result("scenes", "scenes/scenes.csv",
               f"bench scenes --timing lpddr4 --quality compact --out $(@D) {ALL}",
               frames.Scenes, several="*.json"),
        Result("budget", "budget.json", f"error --stage all --json $@ {ALL}", frames.Budget),
        Result("quality", "quality/quality.json", f"bench quality --psnr , --out $(@D) {ALL}",
               frames.Quality),
        Result("sweep", "sweep/sweep.json",
               "bench sweep --out $(@D) $(SCENES) $(size) $(addprefix --point ,$(POINTS))",
               campaigns.Sweep),
        hard("hard", "golden {} $(preset)", pictures=("hard-cases.png",)),
        hard("hard-rtl", "rtl --preset TINY {}"),
        hard("hard-paper", "golden --preset PAPER {}"),
        Result("synth", "synth.json", "synth --stage top --json $@ $(preset)", machines.Synth),
        Result("memories", "memories.json", "memories --json $@ $(preset)", machines.Memories),
        Result("ablation", "ablation/ablation.json", f"bench ablation --out $(@D) {ALL}",
               campaigns.Ablation),
        Result("power", "power.json",
               "power --json $@ $(SCENE) $(addprefix --camera ,$(CAMERA)) $(size) $(preset)",
               machines.Power),
        Result("fpga-tiny", "fpga-tiny.json", "fpga --preset TINY --json $@", machines.Fpga),
        Result("fpga", "fpga.json", "fpga --json $@ $(preset)", machines.Fpga),
        Result("fpga-whole", "fpga-whole.json", "fpga --whole --speed 8 --json $@",
               machines.WholeFpga, hours=True),
        Result("compression", "compression/compression.json",
               "bench compression $(few) --out $(@D) $(SCENES)", compression.Compression,
               hours=True),
        Result("scale", "scale/scale.json", "bench scale --out $(@D) $(size)", scale.Scale,
               pictures=("scale.png",), hours=True, title="Large scenes",
               about="Time and memory of commands by number of Gaussians, on generated scenes."),
        Result("levels", "levels/levels.json",
               "bench levels $(SCENE) $(addprefix --camera ,$(CAMERA)) "
               "--out $(@D) $(size) $(preset)",
               levels.Levels, pictures=("levels.png",), hours=True, title="Levels of detail",
               about="Cycles and error of views by `--lod-pixels`, by the cycle model."),
    )
}  # fmt: skip
"""By name. `fit` is not among them, as its targets are up to the user."""


def rules() -> Iterator[str]:
    """Lines of study/results/rules.mk."""
    yield "# Rules of all results, from study/results/known.py; written by `make commands`."
    for name, of_scenes in (("campaigns", True), ("others", False)):
        quick = [each for each in RESULTS.values() if not each.hours]
        files = [each.file for each in quick if ("SCENES" in each.takes) == of_scenes]
        yield f"{name} := {' '.join(files)}"
    for each in RESULTS.values():
        yield each.rule


if __name__ == "__main__":
    print("\n".join(rules()))
