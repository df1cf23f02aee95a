"""Readable names in generated Verilog: plain identifiers, most others with their line of Python.

Amaranth's names for expressions and for nets of the same name need escaping and say little:
`\\$313`, `\\area$240.groups`. Here the first becomes `frame_py_138_313`: number 313, from line 138
of a file frame.py; or `area_next` if it is the next value of a register `area`, `area_value` if it
is the value of a signal. The second becomes `area_240__groups`, like fields of ports.
"""

import re

from splatcore.sim.rtl.convert import MODULE

KEYWORDS = frozenset(
    """
    accept_on alias always always_comb always_ff always_latch and assert assign assume automatic
    before begin bind bins binsof bit break buf bufif0 bufif1 byte case casex casez cell chandle
    checker class clocking cmos config const constraint context continue cover covergroup
    coverpoint cross deassign default defparam design disable dist do edge else end endcase
    endchecker endclass endclocking endconfig endfunction endgenerate endgroup endinterface
    endmodule endpackage endprimitive endprogram endproperty endsequence endspecify endtable
    endtask enum event eventually expect export extends extern final first_match for force
    foreach forever fork forkjoin function generate genvar global highz0 highz1 if iff ifnone
    ignore_bins illegal_bins implements implies import incdir include initial inout input inside
    instance int integer interconnect interface intersect join join_any join_none large let
    liblist library local localparam logic longint macromodule matches medium modport module
    nand negedge nettype new nexttime nmos nor noshowcancelled not notif0 notif1 null or output
    package packed parameter pmos posedge primitive priority program property protected pull0
    pull1 pulldown pullup pulsestyle_ondetect pulsestyle_onevent pure rand randc randcase
    randsequence rcmos real realtime ref reg reject_on release repeat restrict return rnmos
    rpmos rtran rtranif0 rtranif1 s_always s_eventually s_nexttime s_until s_until_with scalared
    sequence shortint shortreal showcancelled signed small soft solve specify specparam static
    string strong strong0 strong1 struct super supply0 supply1 sync_accept_on sync_reject_on
    table tagged task this throughout time timeprecision timeunit tran tranif0 tranif1 tri tri0
    tri1 triand trior trireg type typedef union unique unique0 unsigned until until_with untyped
    use uwire var vectored virtual void wait wait_order wand weak weak0 weak1 while wildcard
    wire with within wor xnor xor
    """.split()
)
"""Keywords of Verilog and SystemVerilog: IEEE 1800-2023, annex B."""

ESCAPED = re.compile(r"\\(\S+) ")
PORT = re.compile(r"^  (?:in|out)put (?:\[\S+\] )?\\(\S+) ;$", re.M)
NUMBER = re.compile(r"\$\d+")
NAMELESS = re.compile(r"\\(\$\d+) ")

ASSIGNED = re.compile(r"^ +(?:assign )?\\(\$\d+) +<?= (.*);$", re.M)
"""An assignment to a net without a name; its expression. In a block it has many lines."""

TAKEN = re.compile(r"^ +(?:if \(.*\) |assign )?(?:\\(\S+) |(\w+)) *(<?)= \\(\$\d+) ;$", re.M)
"""An assignment of a net without a name to a signal, escaped or plain; to a register if <=."""

SOURCE = re.compile(r'\(\* src = "([^":|]*)[^"]*?:(\d+)[^"]*" \*\)')

ATTRIBUTE = re.compile(r'^ *\(\* src = "[^"]*" \*\)\n|\(\* src = "[^"]*" \*\) ?', re.M)

PART = re.compile(r"^(?:\\(\S+) |(\w+) ?)\[(\d+)(?::(\d+))?\]$")
"""An expression that is a slice of a signal, escaped or plain."""

BLOCK = re.compile(r"^  always @\*.*?^  end$", re.M | re.S)

PATHS = re.compile(r'(?<=src = ")[^"]+(?=")')
PLACE = re.compile(r".*/site-packages/|[^|]*/(?=(?:spec|hdl|sim|eda)/[^|]*$)|.*/")
"""The folders of a path: before a file of this project or of a library, else before its name."""


def identifier(name: str) -> str:
    """A name as a Verilog identifier, escaped if it is a keyword or has other characters."""
    is_plain = re.fullmatch(r"[A-Za-z_]\w*", name, re.A) and name not in KEYWORDS
    return name if is_plain else f"\\{name} "


def readable(text: str) -> str:
    """Make names in Verilog with `src` attributes readable, and remove the folders of the computer
    on which it was generated from the attributes' paths.

    Ports of the first module whose names are keywords stay escaped, as in netlists of it.
    """
    text = PATHS.sub(lambda found: _places(found[0]), text)
    taken = set(re.findall(r"\w+", text))
    plain: dict[str, str] = {}

    def rename(found: re.Match) -> str:
        if found[1] not in plain:
            name = _identifier(found[1])
            while name in taken:
                name += "_"
            taken.add(name)
            plain[found[1]] = name
        return f"{plain[found[1]]} "

    text = MODULE.sub(lambda module: _named(module[0], taken), text)
    first = MODULE.search(text)
    plain |= {name: f"\\{name}" for name in PORT.findall(first[0] if first else "")}
    return ESCAPED.sub(rename, text)


def without_source(text: str) -> str:
    """Remove `src` attributes from Verilog."""
    return ATTRIBUTE.sub("", text)


def _identifier(name: str) -> str:
    """Convert an escaped name to a plain identifier, with its number at the end."""
    if re.fullmatch(r"\w+", name):
        return f"{name}_"
    number = re.match(r"\$(\d+)(.+)", name)
    name = f"{number[2]}_{number[1]}" if number else name
    name = re.sub(r"\W", "_", name.replace(".", "__")).lstrip("_")
    return f"n{name}" if name[0].isdigit() else name


def _places(paths: str) -> str:
    """Files and lines of an attribute, without the folders of the generating computer."""
    return "|".join(PLACE.sub("", path, count=1) for path in paths.split("|"))


def _line(found: re.Match, net: str) -> str:
    """Name a net after the line that made it."""
    file = found[1].rpartition("/")[2].replace(".", "_")
    return f"{file}_{found[2]}_{net[1:]}"


def _named(module: str, taken: set[str]) -> str:
    """Name a module's unnamed nets after the signal that they are assigned to, else after the line
    that made them."""
    names: dict[str, str] = {}
    used = set(taken)

    def give(net: str, name: str):
        if net not in names and name not in used:
            used.add(name)
            names[net] = name

    for escaped, signal, register, net in TAKEN.findall(module):
        if not NUMBER.fullmatch(escaped):
            name = signal or _identifier(escaped)
            give(net, f"{name}_next" if register else f"{name}_value")
    for net, expression in ASSIGNED.findall(module):
        if found := SOURCE.search(expression):
            give(net, _line(found, net))
        elif (part := PART.match(expression)) and not NUMBER.fullmatch(part[1] or ""):
            signal = _identifier(part[1]) if part[1] else part[2]
            give(net, "_".join([signal, *(bit for bit in part.groups()[2:] if bit), net[1:]]))
    for block in BLOCK.findall(module):
        if found := SOURCE.search(block):
            for net, _ in ASSIGNED.findall(block):
                give(net, _line(found, net))
    return NAMELESS.sub(lambda found: f"{names.get(found[1], f'net_{found[1][1:]}')} ", module)
