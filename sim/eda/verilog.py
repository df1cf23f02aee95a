"""Verilog of the machine and of its stages, files for tools beside it, and lint."""

import re
import subprocess
from collections.abc import Iterable, Iterator
from importlib.metadata import version
from pathlib import Path

from amaranth.back import verilog
from amaranth.lib import wiring
from amaranth.lib.wiring import In
from jinja2 import Environment, PackageLoader, StrictUndefined

from splatcore.hdl.lib.holds import BUILT
from splatcore.hdl.stages import STAGES
from splatcore.hdl.top import Top
from splatcore.sim.common.output import write
from splatcore.sim.common.table import comma_separated
from splatcore.sim.eda.macros import Macros, memory_name, module
from splatcore.sim.rtl.verilator import environment
from splatcore.spec.config import CLOCK_HZ, KB, Config

HEADER = """\
// Splatcore {name}, preset {preset}. Generated; the source is {source}.
// Apache-2.0.
//
{about}
"""

MEMORIES_HEADER = """\
// Splatcore's memories, preset {preset}. Generated; memories.csv says where they are.
// Apache-2.0.
//
// One port to write and one to read, each row read a cycle later; what is read stays until the next
// read. A row is never read in the cycle in which it is written; rows begin with no value. To
// replace one by a macro give its module another body.

"""

WAIVERS = Path(__file__).with_name("waivers.vlt")
"""Messages of lint that generated Verilog may cause, each with its reason."""

TOP = "splatcore_top"

MEMORIES_FILE = "splatcore_memories.v"

INSTANCE = re.compile(r"^  (splatcore_\w+) +\\?(\S+) +\($", re.M)

RESET_CYCLES = 2

ENVIRONMENT = Environment(
    loader=PackageLoader("splatcore.sim.eda", "."),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    trim_blocks=True,
    lstrip_blocks=True,
)


def filled(name: str, **facts) -> str:
    """The template `NAME.jinja` beside this file with these facts."""
    return ENVIRONMENT.get_template(f"{name}.jinja").render(facts)


def memory_list(shapes: list[tuple[int, int]], instances: Iterable[tuple[str, str]]) -> str:
    """Memories as CSV: module, words, bits, ports, how many there are, which instances.

    instances: (path, module) of all modules of the machine.
    """
    places: dict[str, list[str]] = {memory_name(*shape): [] for shape in shapes}
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


def core(config: Config, top: str, sources: list[str], waivers: str) -> str:
    """A core file for FuseSoC."""
    facts = {"config": config, "version": version("splatcore")}
    return filled("splatcore.core", **facts, top=top, sources=sources, waivers=waivers)


def constraints(config: Config, component: wiring.Component) -> str:
    """Constraints for synthesis and timing at `CLOCK_HZ`."""
    ports: dict[bool, list[str]] = {True: [], False: []}
    for path, member, _ in component.signature.flatten(component):
        ports[member.flow == In].append("__".join(map(str, path)))
    period = 1e9 / CLOCK_HZ
    times = {"period": period, "uncertainty": period / 10, "half": period / 2}
    facts = {"config": config, "megahertz": CLOCK_HZ / 1e6, "reset": RESET_CYCLES}
    return filled("splatcore.sdc", **times, **facts, inputs=ports[True], outputs=ports[False])


def stage_source(
    name: str, component: wiring.Component, config: Config, platform: Macros | None = None
) -> str:
    """Verilog text of a component, its docstring on top; memories are inside without a platform."""
    about = "\n".join(f"// {line}".rstrip() for line in (component.__doc__ or "").splitlines())
    source = type(component).__module__.removeprefix("splatcore.").replace(".", "/") + ".py"
    head = HEADER.format(name=name, source=source, preset=config.name, about=about)
    name = f"splatcore_{name}"
    text = verilog.convert(component, name, platform or BUILT, emit_src=False)
    return f"{head}\n{_plain(text, name)}"


def _plain(text: str, top: str) -> str:
    """Verilog whose modules have names without dots, and no wires of no bits, [-1:0], which would
    be two."""
    names: dict[str, str] = {}

    def rename(found: re.Match) -> str:
        name = re.sub(r"\W", "_", found[0][1:-1])
        while names.setdefault(name, found[0]) != found[0]:
            name += "_"
        return f"{name} "

    text = re.sub(rf"\\{top}\.\S+ ", rename, text)
    return re.sub(r"^  wire \[-1:0\] .*;\n", "", text, flags=re.M)


def instances(text: str, top: str) -> Iterator[tuple[str, str]]:
    """Path and module of all that is inside of a Verilog text's top module."""
    modules = re.split(r"^module ", text, flags=re.M)[1:]
    inside = {re.match(r"\w+", body)[0]: INSTANCE.findall(body) for body in modules}

    def visit(path: str, name: str) -> Iterator[tuple[str, str]]:
        for inner, instance in inside.get(name, ()):
            yield f"{path}.{instance}", inner
            yield from visit(f"{path}.{instance}", inner)

    return visit(top, top)


def write_stages(config: Config, folder: Path) -> list[Path]:
    """Write every stage of a machine into a folder, and the waivers; the paths of the files."""
    texts = {
        f"splatcore_{k}.v": stage_source(k, make(config), config) for k, make in STAGES.items()
    }
    return _written(folder, texts)


def write_top(config: Config, folder: Path) -> list[Path]:
    """Write the whole machine into a folder, its memories, and what tools want to know of them."""
    top, macros = Top(config), Macros()
    source = stage_source("top", top, config, macros)
    shapes = sorted(set(macros.sizes))
    memories = MEMORIES_HEADER.format(preset=config.name)
    memories += "\n".join(module(*shape) for shape in shapes)
    texts = {
        f"{TOP}.v": source,
        MEMORIES_FILE: memories,
        "memories.csv": memory_list(shapes, instances(source, TOP)),
        "splatcore.core": core(config, TOP, [MEMORIES_FILE, f"{TOP}.v"], WAIVERS.name),
        "splatcore.sdc": constraints(config, top),
    }
    return _written(folder, texts)


def _written(folder: Path, texts: dict[str, str]) -> list[Path]:
    """Write files by name into a folder, and the waivers; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    texts |= {WAIVERS.name: WAIVERS.read_text()}
    paths = {folder / name: text for name, text in texts.items()}
    for path, text in paths.items():
        write(path, text.encode())
    return list(paths)


WRITERS = {"top": write_top, "stages": write_stages}
"""Files to write, by name: functions of a machine and a folder that return paths."""


def lint(top: str, *paths: Path) -> list[str]:
    """Messages of `verilator --lint-only -Wall` about files beyond the waivers."""
    done = subprocess.run(
        ["verilator", "--lint-only", "-Wall", "--top-module", top, WAIVERS, *paths],
        env=environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    return [line for line in done.stderr.splitlines() if line.startswith("%")]
