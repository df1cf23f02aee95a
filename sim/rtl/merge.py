"""Equal modules of Amaranth's Verilog merged: simulators translate and compile them once.

Amaranth writes a module for each component, and names ports without a name of their own by numbers
of the whole design.
"""

import re

from splatcore.sim.rtl.convert import MODULE

NAME = re.compile(r"^module (\\\S+|\w+)")
INSTANCE = re.compile(r"^  (\\\S+|\w+)  ((?:\\\S+ |\w+) \(\n)(.*?^  \);)$", re.M | re.S)
NUMBERED = re.compile(r"\\port\$\d+\$\d+ ")
CONNECTED = re.compile(r"^    \.(\\port\$\d+\$\d+ )", re.M)


def merged(source: str) -> str:
    """Verilog in which each module stands for all that differ from it only in names of ports."""
    modules = {NAME.match(text)[1]: text for text in MODULE.findall(source)}
    ports, same, first, kept = {}, {}, {}, []

    def merge(name: str) -> str:
        """Name of the module that stands for this one; its submodules come first."""
        if name not in same:
            text, header = INSTANCE.sub(instance, modules[name]), modules[name].partition(";")[0]
            numbered = dict.fromkeys(NUMBERED.findall(header)) if name != "top" else ()
            own = ports[name] = {port: rf"\port${k} " for k, port in enumerate(numbered)}
            text = NUMBERED.sub(lambda found: own.get(found[0], found[0]), text)
            same[name] = first.setdefault(text.partition("(")[2], name)
            if same[name] == name:
                kept.append(text)
        return same[name]

    def instance(found: re.Match) -> str:
        name, start, connections = found.groups()
        if name not in modules:
            return found[0]
        target, own = merge(name), ports[name]
        return f"  {target}  {start}" + CONNECTED.sub(
            lambda port: f"    .{own[port[1]]}", connections
        )

    for name in modules:
        merge(name)
    return "\n\n".join(kept) + "\n"
