"""Docstrings of components: their lists of ports are those of the signature.

A component's docstring lists its ports under `Members:`, one entry per line, indented:

    Members:
        i: in, stream of …
        a, b: in, …
        small: in, only if `Config.small_models`; …

An entry names one port or several with the same text, and begins with the direction. A port that
some machines lack has the words "only if". Longer entries go on in lines that are indented further.
`Parameters:` lists arguments of the constructor in the same way, `Internal:` attributes that
proofs and tests read; neither has directions.
"""

import inspect
import re
from dataclasses import replace
from functools import cache
from importlib import import_module
from itertools import product
from pkgutil import walk_packages

import pytest
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore import hdl
from splatcore.hdl.arithmetic import convert, float
from splatcore.hdl.lib import latency
from splatcore.hdl.memory import words
from splatcore.hdl.points import colour, compensation, look_up, project
from splatcore.spec import microprogram
from splatcore.spec import unary as functions
from splatcore.spec.config import DEFAULT, FPGA, PAPER, TINY
from splatcore.spec.number import FP24, Fixed

MACHINES = (
    TINY,
    PAPER,
    FPGA,
    replace(TINY, name="WINDOWS", address_bits=64, port=256),
    replace(TINY, name="PLAIN", sh_degree=0, culling="none"),
)
"""Machines that together have every port."""

PREFIX = f"{hdl.__name__}."

FORMAT, FIXED = FP24, Fixed(4, 4)

COMPENSATED = (compensation.Fade, compensation.Log, compensation.LogSum, compensation.Minor,
               compensation.Product)  # fmt: skip

SOME = {
    "config": MACHINES, "format": [FORMAT], "source": [FORMAT], "target": [FORMAT],
    "fixed": [FIXED], "scale": [None, range(4)], "function": ["rsqrt"], "shape": [8],
    "names": [("events",)], "items": ["items"], "program": [microprogram.program("place")],
    "late": [{}, {"culled": 1}], "marks": [False, True], "beats": [2], "number": [0],
    "rasterizer": [0], "latency": [1], "base": [8], "count_bits": [8], "depth": [16],
    "layout": [float.operand(FORMAT)], "zeros": [1],
    "registers": [latency.spread(0, {"round": 1})],
    "path": [functions.datapath("reciprocal", fraction) for fraction in range(4, 20)],
}  # fmt: skip
"""Arguments of constructors, by name; others are 4 if they are required."""


def components() -> list[type[wiring.Component]]:
    """Every component in `hdl`."""
    modules = [import_module(found.name) for found in walk_packages(hdl.__path__, PREFIX)]
    return [
        kind
        for module in modules
        for kind in vars(module).values()
        if inspect.isclass(kind)
        and issubclass(kind, wiring.Component)
        and kind.__module__ == module.__name__
    ]


COMPONENTS = components()


def name_of(kind: type) -> str:
    return f"{kind.__module__.removeprefix(PREFIX)}.{kind.__name__}"


def of_projection(kind: type) -> list[wiring.Component]:
    """The parts of a kind that make colours, from all machines."""
    parts = [project.Project(config).colour for config in MACHINES]
    return [part for part in parts if isinstance(part, kind)]


@cache
def instances(kind: type[wiring.Component]) -> list[wiring.Component]:
    """The component in several machines, and with several arguments."""
    if kind is colour.Colour:
        return of_projection(kind)
    given = dict(SOME)
    if kind in COMPENSATED:
        given["config"] = [config for config in MACHINES if config.compensates]
    elif kind is look_up.LookUp:
        given["config"] = [replace(PAPER, sh_degree=k) for k in (0, 1)]
    elif kind is words.Words:
        given["config"] = [DEFAULT]
    elif kind is convert.Convert:
        given["scale"] = [0]
    taken = {
        name: given.get(name, [4])
        for name, parameter in inspect.signature(kind).parameters.items()
        if parameter.default is inspect.Parameter.empty or name in ("scale", "late", "marks")
    }
    return [kind(**dict(zip(taken, values, strict=True))) for values in product(*taken.values())]


ENTRY = re.compile(r"    (\w+(?:, \w+)*): (\S.*)")


def entries(kind: type, heading: str) -> dict[str, str]:
    """Names and texts listed under a heading of a docstring, its own or an inherited one."""
    for each in kind.__mro__:
        _, found, rest = inspect.cleandoc(each.__doc__ or "").partition(f"\n{heading}:\n")
        if found:
            break
    listed: dict[str, str] = {}
    names: list[str] = []
    for line in rest.partition("\n\n")[0].splitlines():
        entry = ENTRY.fullmatch(line)
        if entry:
            names = entry[1].split(", ")
            assert not listed.keys() & names, f"{kind.__name__}: {entry[1]} is listed twice"
            listed |= dict.fromkeys(names, entry[2])
        else:
            assert names and line.startswith(" " * 8), f"{kind.__name__}: no entry: {line}"
            listed |= {name: f"{listed[name]} {line.strip()}" for name in names}
    return listed


def errors(kind: type[wiring.Component], made: list[wiring.Component]) -> list[str]:
    """Differences between the list of ports and the signatures of some instances."""
    signatures = [component.signature.members for component in made]
    ports = {name: member.flow for members in signatures for name, member in members.items()}
    listed, found = entries(kind, "Members"), []
    for name in sorted(ports.keys() - listed.keys()):
        found.append(f"{name} is missing")
    for name in sorted(listed.keys() - ports.keys()):
        found.append(f"{name} is no port")
    for name in sorted(listed.keys() & ports.keys()):
        direction = "in" if ports[name] is In else "out"
        if not listed[name].startswith(f"{direction}, "):
            found.append(f"{name} is not `{direction}`")
        optional = any(name not in members for members in signatures)
        if optional != listed[name].startswith(f"{direction}, only if "):
            found.append(f"{name} is {'' if optional else 'not '}optional")
    return found


@pytest.mark.parametrize("kind", COMPONENTS, ids=name_of)
def test_members_are_the_ports(kind):
    assert not errors(kind, instances(kind))


@pytest.mark.parametrize("kind", COMPONENTS, ids=name_of)
def test_parameters_and_internal_signals_exist(kind):
    assert entries(kind, "Parameters").keys() <= inspect.signature(kind.__init__).parameters.keys()
    for component in instances(kind):
        for name in entries(kind, "Internal"):
            assert hasattr(component, name), name


def test_all_components_are_found():
    assert len(COMPONENTS) > 80


class Right(wiring.Component):
    """A component for the tests below.

    Parameters:
        small: whether there is a port `small`

    Members:
        i: in, stream of bytes
        a, b: out, one bit per byte
            of the item
        small: in, only if the parameter is given: the item is small

    **Timing**: none.
    """

    def __init__(self, small: bool = False):
        ports = {"i": In(stream.Signature(8)), "a": Out(1), "b": Out(1)}
        super().__init__(ports | ({"small": In(1)} if small else {}))


def test_entries():
    assert entries(Right, "Members") == {
        "i": "in, stream of bytes",
        "a": "out, one bit per byte of the item",
        "b": "out, one bit per byte of the item",
        "small": "in, only if the parameter is given: the item is small",
    }
    assert entries(Right, "Parameters") == {"small": "whether there is a port `small`"}
    assert entries(Right, "Internal") == {}


def described(old: str, new: str) -> type:
    """`Right` with a change of its docstring."""
    assert old in Right.__doc__
    return type("Wrong", (Right,), {"__doc__": Right.__doc__.replace(old, new)})


@pytest.mark.parametrize(
    "old, new, found",
    [
        ("a, b: out", "a: out", ["b is missing"]),
        ("a, b: out", "a, b, exponent: out", ["exponent is no port"]),
        ("i: in", "i: out", ["i is not `in`"]),
        ("in, only if the", "in, the", ["small is optional"]),
        ("in, stream", "in, only if there is a stream", ["i is not optional"]),
    ],
)
def test_wrong_lists_are_found(old, new, found):
    made = [Right(), Right(small=True)]
    assert errors(Right, made) == []
    assert errors(described(old, new), made) == found


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("small: in", "a: in", "Wrong: a is listed twice"),
        ("i: in, stream", "i, stream", "Wrong: no entry:     i, stream of bytes"),
    ],
)
def test_malformed_lists_are_refused(old, new, message):
    with pytest.raises(AssertionError, match=re.escape(message)):
        entries(described(old, new), "Members")
