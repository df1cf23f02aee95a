"""Files for tools beside the generated Verilog: memories, a core file, constraints."""

import csv
from collections.abc import Iterable
from importlib.metadata import version
from io import StringIO

from amaranth.lib import wiring
from amaranth.lib.wiring import In
from jinja2 import Environment, PackageLoader, StrictUndefined

from splatcore.sim.eda.macros import memory_name
from splatcore.spec.config import CLOCK_HZ, KB, Config

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
    for path, module in instances:
        if module in places:
            places[module].append(path)
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("module", "words", "bits", "ports", "count", "kilobytes", "instances"))
    for words, bits in shapes:
        paths = places[memory_name(words, bits)]
        kilobytes = f"{words * bits * len(paths) / 8 / KB:.3f}"
        row = (words, bits, "1 write, 1 read", len(paths), kilobytes, " ".join(paths))
        table.writerow((memory_name(words, bits), *row))
    return text.getvalue()


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
