"""Hierarchy of a netlist in RTLIL: find its instances, cut parts out of it."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

from splatcore.eda.gates.macros import memory_size
from splatcore.eda.gates.synth import Netlist

MODULE = re.compile(r"^module (\S+)\n(.*?)^end\n", re.M | re.S)
CELL = re.compile(r"^(  cell )(\\\S+)( (\S+))$", re.M)
"""A cell that instantiates a module; types of yosys's own cells begin with $, not a backslash."""

PORT = re.compile(r"^  wire .*\b(?:input|output) \d+ .*\n", re.M)

WIRE = re.compile(r"\\port\$\d+\$\d+")


@dataclass(frozen=True)
class Instance:
    """An instance of a module. path: names from the top on, without the top's own."""

    path: str
    module: str


class Hierarchy:
    """RTLIL by modules. top: name of the top module."""

    def __init__(self, text: str, top: str = "top"):
        self.modules = {found[1]: found[2] for found in MODULE.finditer(text)}
        self.top = "\\" + top

    @cached_property
    def cells(self) -> dict[str, list[tuple[str, str]]]:
        """Cells of each module as (name, module), memories included."""
        return {
            name: [(re.sub(r"^\\|\$\d+$", "", found[4]), found[2]) for found in CELL.finditer(body)]
            for name, body in self.modules.items()
        }

    def instances(self, module: str | None = None, path: str = "") -> Iterator[Instance]:
        """A module and all instances in it, top down; memories have no text in `modules`."""
        module = module or self.top
        yield Instance(path, module)
        for name, inner in self.cells.get(module, ()):
            yield from self.instances(inner, f"{path}.{name}" if path else name)

    def piece(self, root: Instance, is_cut: Callable[[str], object]) -> Netlist:
        """The contents of an instance, in which all instances with `is_cut(path)` are black boxes.

        Modules are renamed by their order, so that equal pieces have equal texts.
        """
        names: dict[str, str] = {root.module: "\\top"}
        texts, memories = [], []

        def visit(instance: Instance):
            for name, inner in self.cells[instance.module]:
                path = f"{instance.path}.{name}" if instance.path else name
                if inner not in self.modules:
                    memories.append(memory_size(inner))
                elif is_cut(path):
                    names[inner] = f"\\cut{len(names)}"
                    ports = "".join(PORT.findall(self.modules[inner]))
                    texts.append(f"attribute \\blackbox 1\nmodule {names[inner]}\n{ports}end\n")
                else:
                    names[inner] = f"\\module{len(names)}"
                    visit(Instance(path, inner))
            body = CELL.sub(
                lambda cell: cell[1] + names.get(cell[2], cell[2]) + cell[3],
                self.modules[instance.module],
            )
            texts.append(f"module {names[instance.module]}\n{body}end\n")

        visit(root)
        # Amaranth numbers wires through the whole netlist: renumber them.
        wires: dict[str, str] = {}
        text = WIRE.sub(lambda w: wires.setdefault(w[0], f"\\port{len(wires)}"), "\n".join(texts))
        return Netlist(text, tuple(memories))
