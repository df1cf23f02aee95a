"""Verilog of the machine and of its stages, accompanying files for tools, and lint."""

import re
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.eda.deliver.names import readable, without_source
from splatcore.eda.deliver.register_files import write_register_files
from splatcore.eda.gates.macros import PREFIX, Macros, memory_name, module, sizes_in
from splatcore.eda.template import filled, write_texts
from splatcore.hdl.lib.holds import BUILT
from splatcore.hdl.stages import STAGES
from splatcore.hdl.top import Top
from splatcore.sim.common.table import comma_separated
from splatcore.sim.rtl.convert import converted, kept
from splatcore.sim.rtl.verilator import environment
from splatcore.spec.axi import ID_BITS
from splatcore.spec.config import CLOCK_HZ, KB, Config
from splatcore.spec.registers import register_map

HEADER = """\
// Splatcore {name}, preset {preset}. Generated; the source is {source}.
// Apache-2.0.
//
{about}
"""

MEMORIES_HEADER = """\
// Splatcore's memories, preset {preset}. Generated; memories.csv lists their instances.
// Apache-2.0.
//
// One write port and one read port; a row is read with a latency of one cycle, and read_data stays
// until the next read. A row is never read in the cycle in which it is written. Rows have no
// initial values. To use a macro, replace the body of its module.

"""

WAIVERS = Path(__file__).with_name("waivers.vlt")
"""Lint messages allowed for generated Verilog, each with its reason."""

INSTANCE = re.compile(r"^  (\w+) +(\w+) +\($", re.M)

RESET_CYCLES = 2


@dataclass(frozen=True)
class Names:
    """Naming of generated Verilog.

    prefix: of the names of modules and files
    source_lines: whether to keep attributes `src` that name lines of Python
    """

    prefix: str = PREFIX
    source_lines: bool = True

    @property
    def top(self) -> str:
        """Name of the machine's module."""
        return f"{self.prefix}_top"

    @property
    def sources(self) -> list[str]:
        """Names of the machine's Verilog files."""
        return [f"{self.prefix}_memories.v", f"{self.top}.v"]


NAMES = Names()


def memory_list(
    shapes: list[tuple[int, int]], instances: Iterable[tuple[str, str]], prefix: str
) -> str:
    """Memories as CSV: module, words, bits, ports, number and paths of its instances.

    shapes: words and bits of each module
    instances: (path, module) of all instances of the machine
    """
    places: dict[str, list[str]] = {memory_name(*shape, prefix): [] for shape in shapes}
    for path, name in instances:
        if name in places:
            places[name].append(path)
    rows = []
    for (words, bits), (name, paths) in zip(shapes, places.items(), strict=True):
        kilobytes = f"{words * bits * len(paths) / 8 / KB:.3f}"
        size = {"module": name, "words": words, "bits": bits, "ports": "1 write, 1 read"}
        found = {"count": len(paths), "kilobytes": kilobytes, "instances": " ".join(paths)}
        rows.append(size | found)
    return comma_separated(rows)


def ports_of(component: wiring.Component) -> dict[bool, list[str]]:
    """Verilog names of a component's inputs (True) and outputs, without clk and rst."""
    ports: dict[bool, list[str]] = {True: [], False: []}
    for path, member, _ in component.signature.flatten(component):
        ports[member.flow == In].append("__".join(map(str, path)))
    return ports


def constraints(config: Config, ports: dict[bool, list[str]]) -> str:
    """Constraints for synthesis and timing at `CLOCK_HZ` (SDC).

    ports: names of inputs (True) and outputs
    """
    period = 1e9 / CLOCK_HZ
    times = {"period": period, "uncertainty": period / 10, "half": period / 2}
    facts = {"config": config, "megahertz": CLOCK_HZ / 1e6, "reset": RESET_CYCLES}
    return filled(
        "deliver/splatcore.sdc", **times, **facts, inputs=ports[True], outputs=ports[False]
    )


def stage_source(
    name: str,
    component: wiring.Component,
    config: Config,
    platform: Macros | None = None,
    names: Names = NAMES,
) -> str:
    """Verilog of a component with its docstring as a comment at the top.

    name: of the stage; the module's name is this with the prefix
    platform: makes memories separate modules; by default they are inside
    """
    about = "\n".join(f"// {line}".rstrip() for line in (component.__doc__ or "").splitlines())
    source = type(component).__module__.removeprefix("splatcore.").replace(".", "/") + ".py"
    head = HEADER.format(name=name, source=source, preset=config.name, about=about)
    module = f"{names.prefix}_{name}"
    convert = kept if isinstance(component, Top) else converted  # the whole takes half a minute
    text = readable(_plain(convert(component, module, platform or BUILT, emit_src=True), module))
    return f"{head}\n{text if names.source_lines else without_source(text)}"


def _plain(text: str, top: str) -> str:
    """Replace dots in names of modules, and remove wires of width 0, [-1:0], which Verilog would
    take for two bits."""
    names: dict[str, str] = {}

    def rename(found: re.Match) -> str:
        name = re.sub(r"\W", "_", found[0][1:-1])
        while names.setdefault(name, found[0]) != found[0]:
            name += "_"
        return f"{name} "

    text = re.sub(rf"\\{top}\.\S+ ", rename, text)
    return re.sub(r"^(?:  \(\*.*\*\)\n)?  wire \[-1:0\] .*;\n", "", text, flags=re.M)


def instances(text: str, top: str) -> Iterator[tuple[str, str]]:
    """Path and module of all instances in the top module of a Verilog text."""
    modules = re.split(r"^module ", text, flags=re.M)[1:]
    inside = {re.match(r"\w+", body)[0]: INSTANCE.findall(body) for body in modules}

    def visit(path: str, name: str) -> Iterator[tuple[str, str]]:
        for inner, instance in inside.get(name, ()):
            yield f"{path}.{instance}", inner
            yield from visit(f"{path}.{instance}", inner)

    return visit(top, top)


def write_stages(config: Config, folder: Path, names: Names = NAMES) -> list[Path]:
    """Write all stages of a machine and the waivers into a folder. Returns the files' paths."""
    texts = {
        f"{names.prefix}_{k}.v": stage_source(k, make(config), config, names=names)
        for k, make in STAGES.items()
    }
    return write_texts(folder, texts | {WAIVERS.name: WAIVERS.read_text()})


def write_top(config: Config, folder: Path, names: Names = NAMES) -> list[Path]:
    """Write the whole machine, its memories and files for tools into a folder.

    Returns the files' paths.
    """
    top = Top(config)
    source = stage_source("top", top, config, Macros(names.prefix), names)
    shapes = sizes_in(source, names.prefix)
    memories = MEMORIES_HEADER.format(preset=config.name)
    memories += "\n".join(module(*shape, names.prefix) for shape in shapes)
    facts = {"config": config, "names": names}
    texts = {
        **dict(zip(names.sources, (memories, source), strict=True)),
        "memories.csv": memory_list(shapes, instances(source, names.top), names.prefix),
        f"{names.prefix}.core": filled(
            "deliver/splatcore.core", version=version("splatcore"), waivers=WAIVERS.name, **facts
        ),
        f"{names.prefix}_testbench.v": filled(
            "deliver/testbench.v", registers=register_map(config), ids=ID_BITS, reset=RESET_CYCLES,
            **facts,
        ),
        f"{names.prefix}.sdc": constraints(config, ports_of(top)),
        WAIVERS.name: WAIVERS.read_text(),
    }  # fmt: skip
    return write_texts(folder, texts)


def write_registers(config: Config, folder: Path, names: Names = NAMES) -> list[Path]:
    """Write register map, C header and driver into a folder. Returns the files' paths."""
    return write_register_files(config, folder, names.prefix)


WRITERS = {"top": write_top, "registers": write_registers, "stages": write_stages}
"""Writers of files by name: functions of a machine, a folder and names, which return paths."""


def lint(top: str, *paths: Path) -> list[str]:
    """Messages of `verilator --lint-only -Wall` for these files that are not waived."""
    done = subprocess.run(
        ["verilator", "--lint-only", "-Wall", "--top-module", top, WAIVERS, *paths],
        env=environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    return [line for line in done.stderr.splitlines() if line.startswith("%")]
