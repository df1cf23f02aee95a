"""Observers in the machine's Verilog: when does each register load a value?

A register that holds its value need not be clocked (`synth --liberty` gates its clock). Amaranth
writes a register as `q <= next` and a block that computes `next`: first `next = q`, then
assignments under conditions. Each such block also computes `q$loads`: 1 where an assignment other
than the reset's is made, one bit if all of them assign the whole register. Registers without a
block load in every cycle.
"""

import re

from splatcore.sim.rtl.convert import MODULE

SUFFIX = "$loads"

NAME = r"(?:\\\S+ |\w+)"
FLIP_FLOP = re.compile(rf"^  always @\(posedge clk\)\n    ({NAME}) *<= (.*?) *;$", re.M)
DECLARED = re.compile(r"^  reg ({0}|\[\d+:0\] {0})(?= = |;)".replace("{0}", NAME), re.M)
BLOCK = re.compile(
    rf"^  always @\* begin\n(?:    if .*? begin end\n)?    ({NAME}) *= (.*?) *;\n(.*?)^  end$",
    re.M | re.S,
)
WRITTEN = re.compile(
    rf"^  always @\(posedge clk\)\n    if \((.*)\)\n      ({NAME}) *\[.*?\] <= ", re.M
)
"""A write to a memory of flip-flops."""

RESET = re.compile(r"^    if \(rst\) begin\n.*?^    end$", re.M | re.S)


def observed(verilog: str) -> str:
    """Add the observers to all modules."""
    return MODULE.sub(lambda found: _observed(found[0]), verilog)


def observer(register: str) -> str:
    """The name of a register's observer."""
    return f"\\{register.removeprefix(chr(92)).strip()}{SUFFIX} "


def _observed(module: str) -> str:
    registers = {next_: register for register, next_ in FLIP_FLOP.findall(module)}
    ranges = {}
    for found in DECLARED.findall(module):
        range_, _, name = found.rpartition("] ")
        ranges[name.strip()] = f"{range_}] " if range_ else ""
    declared, held = [], set()

    def block(found: re.Match) -> str:
        register = registers.get(found[1].strip())
        if register is None or register.strip() != found[2].strip():
            return found[0]
        held.add(register)
        name, next_, body = observer(register), re.escape(found[1].strip()), found[3]
        reset = RESET.search(body)
        body, rest = (body[: reset.start()], body[reset.start() :]) if reset else (body, "")
        assignment = re.compile(rf"^( +){next_} *(\[[\d:]+\])? = .*?;$", re.M)
        slices = any(part for _, part in assignment.findall(body))
        declared.append(f"  reg {ranges[register.strip()] if slices else ''}{name};\n")

        def watched(found: re.Match) -> str:
            return f"{found[1]}begin {found[0].strip()} {name}{found[2] or ''} = '1; end"

        body = assignment.sub(watched, body)
        head = found[0][: found.start(3) - found.start()]
        return f"{head}    {name} = 0;\n{body}{rest}  end"

    module = BLOCK.sub(block, module)
    free = [name for name in registers.values() if name not in held]
    always = [f"  wire {observer(name)} = 1'h1;\n" for name in free]
    always += [f"  wire {observer(name)} = {enable};\n" for enable, name in WRITTEN.findall(module)]
    return re.sub(
        r"\A(module .*?;\n)", lambda found: found[0] + "".join(declared + always), module,
        count=1, flags=re.S,
    )  # fmt: skip
