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
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib import import_module
from pkgutil import walk_packages

import pytest
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore import hdl
from splatcore.hdl.arithmetic import (
    add,
    compare,
    convert,
    float,
    minmax,
    multiply,
    unary,
    unary_ends,
)
from splatcore.hdl.lib import counters, credit, latency
from splatcore.hdl.lib import stream as streams
from splatcore.hdl.memory import fetch, store, turns, words, write_combiner
from splatcore.hdl.points import array, colour, compensation, look_up, project, terms
from splatcore.hdl.raster import blend, evaluate, rasterizer
from splatcore.hdl.sorting import cascade
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

COMPENSATING = [config for config in MACHINES if config.compensates]


def of_projection(kind: type) -> list[wiring.Component]:
    """The parts of a kind that make colours, from all machines."""
    parts = [project.Project(config).colour for config in MACHINES]
    return [part for part in parts if isinstance(part, kind)]


MADE: dict[type, Callable[[], list[wiring.Component]]] = {
    add.Add: lambda: [add.Add(FORMAT, 1)],
    add.MultiplyAdd: lambda: [add.MultiplyAdd(FORMAT, 1)],
    array.Array: lambda: [
        array.Array(TINY, program, late=late)
        for program in [microprogram.program("place")]
        for late in ({}, {program.fields[0]: 1})
    ],
    blend.Blend: lambda: [blend.Blend(config, 4) for config in MACHINES],
    cascade.Pair: lambda: [cascade.Pair(TINY, 4)],
    colour.Colour: lambda: of_projection(colour.Colour),
    compare.Compare: lambda: [compare.Compare(FORMAT, 1)],
    compensation.Product: lambda: [compensation.Product(config, 1) for config in COMPENSATING],
    convert.Convert: lambda: [convert.Convert(FORMAT, FORMAT, 1)],
    convert.FromFixed: lambda: [
        convert.FromFixed(FIXED, FORMAT, 1, scale) for scale in (None, range(4))
    ],
    convert.ToFixed: lambda: [
        convert.ToFixed(FORMAT, FIXED, 1, scale) for scale in (None, range(4))
    ],
    counters.Counters: lambda: [counters.Counters(("events",))],
    credit.Credit: lambda: [credit.Credit(2, "items")],
    evaluate.Evaluate: lambda: [evaluate.Evaluate(TINY, 0)],
    fetch.Fetch: lambda: [fetch.Fetch(TINY, 16, 8, marks=marks) for marks in (False, True)],
    fetch.FetchBeats: lambda: [fetch.FetchBeats(TINY, 16, 8)],
    fetch.Unpack: lambda: [fetch.Unpack(TINY, 8)],
    float.Round: lambda: [
        float.Round(FORMAT, float.operand(FORMAT), 1, latency.spread(0, {"round": 1}))
    ],
    float.Unpack: lambda: [float.Unpack(FORMAT)],
    look_up.LookUp: lambda: [look_up.LookUp(replace(PAPER, sh_degree=k)) for k in (0, 1)],
    minmax.Choice: lambda: [minmax.Choice(FORMAT)],
    minmax.Clamp: lambda: [minmax.Clamp(FORMAT)],
    minmax.Maximum: lambda: [minmax.Maximum(FORMAT)],
    multiply.Multiply: lambda: [multiply.Multiply(FORMAT, 1)],
    rasterizer.Rasterizer: lambda: [rasterizer.Rasterizer(TINY, 0)],
    store.Store: lambda: [store.Store(TINY, 2)],
    streams.Fork: lambda: [streams.Fork(8, 2)],
    streams.Pipe: lambda: [streams.Pipe(2)],
    streams.Queue: lambda: [streams.Queue(8, 4)],
    streams.Register: lambda: [streams.Register(8)],
    streams.Slot: lambda: [streams.Slot(8)],
    streams.Stage: lambda: [streams.Stage(8)],
    terms.Terms: lambda: [terms.Terms(config, 8) for config in (TINY, MACHINES[-1])],
    turns.Turns: lambda: [turns.Turns(2)],
    unary.Lookup: lambda: [
        unary.Lookup(functions.datapath("reciprocal", fraction)) for fraction in range(4, 20)
    ],
    unary.Unary: lambda: [unary.Unary("rsqrt", FORMAT, 1)],
    unary_ends.Pack: lambda: [unary_ends.Pack("rsqrt", FORMAT)],
    unary_ends.Unpack: lambda: [unary_ends.Unpack("rsqrt", FORMAT)],
    words.Words: lambda: [words.Words(DEFAULT, 4)],
    write_combiner.WriteCombiner: lambda: [write_combiner.WriteCombiner(TINY, 4)],
} | {
    kind: lambda kind=kind: [kind(config) for config in COMPENSATING]
    for kind in (compensation.Fade, compensation.Log, compensation.LogSum, compensation.Minor)
}
"""Components that take other arguments than a `Config`, or not every `Config`: some instances."""


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


@cache
def instances(kind: type[wiring.Component]) -> list[wiring.Component]:
    """The component in several machines."""
    return MADE[kind]() if kind in MADE else [kind(config) for config in MACHINES]


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
    assert MADE.keys() <= set(COMPONENTS)


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
