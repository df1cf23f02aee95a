"""Components: their constructors list their ports, each with its meaning.

A port is one line of the constructor: name, direction, shape, and a comment behind it or above it:

    ports = {
        "i": In(stream_of(point_record(config))),
        # codes of `format`
        "a": In(format.width),
        "b": In(format.width),
        # one bit per client: it requests, and has not …
        "wants": In(count),
    }
    if config.small_models:
        ports["small"] = In(1)  # …

A port without a comment has a shape that says what it is (a stream, or a layout with a name), or it
shares the comment above the ports before it of the same direction and shape. In a docstring,
`Parameters:` lists arguments of the constructor, `Internal:` attributes that proofs and tests read,
one entry per line.
"""

import ast
import inspect
import re
import textwrap
from dataclasses import replace
from importlib import import_module
from pkgutil import walk_packages

import pytest
from amaranth.lib import wiring

from splatcore import hdl
from splatcore.hdl.binning import list_writer
from splatcore.hdl.lib import stream as streams
from splatcore.hdl.memory import axi, fetch
from splatcore.hdl.points import level
from splatcore.hdl.raster import quads, raster, rasterizer, recent, shared
from splatcore.hdl.sorting import cascade, sorter
from splatcore.spec.config import TINY

PREFIX = f"{hdl.__name__}."

IN_QUADS = replace(TINY, lanes="quads", rasterizers=2)

INTERNAL = {
    axi.Axi: lambda: axi.Axi(TINY),
    cascade.Pair: lambda: cascade.Pair(TINY, 4),
    fetch.Fetch: lambda: fetch.Fetch(TINY, 16, 8),
    level.Level: level.Level,
    list_writer.ListWriter: lambda: list_writer.ListWriter(TINY),
    quads.Quad: lambda: quads.Quad(IN_QUADS),
    raster.Raster: lambda: raster.Raster(TINY),
    rasterizer.Rasterizer: lambda: rasterizer.Rasterizer(TINY, 0),
    recent.Recent: lambda: recent.Recent(TINY, 8, 3),
    shared.Feeder: lambda: shared.Feeder(IN_QUADS, 0),
    sorter.Sorter: lambda: sorter.Sorter(TINY),
    streams.Fork: lambda: streams.Fork(8, 2),
    streams.Queue: lambda: streams.Queue(8, 4),
    streams.Register: lambda: streams.Register(8),
}
"""The components that have internal signals."""

NAMED = re.compile(r"stream|layout|record|Layout|[Ss]tate|[A-Z]{4}|operand\(|axi")
"""Shapes that say what a port is."""


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


def ports(source: str) -> dict[str, tuple[int, str]]:
    """Names of the ports in a constructor's source; the line and the text of each one's shape."""
    found = {}
    for node in ast.walk(ast.parse(source)):
        pairs = []
        if isinstance(node, ast.Dict):
            pairs = zip(node.keys, node.values, strict=True)
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
            pairs = [(node.targets[0].slice, node.value)]
        for name, value in pairs:
            shape = ast.unparse(value)
            if isinstance(name, ast.Constant) and re.match(r"(In|Out)\(", shape):
                found[name.value] = name.lineno, shape
    return found


def undescribed(source: str) -> list[str]:
    """Ports in a constructor's source without a meaning."""
    lines, found, shared = source.splitlines(), [], ""
    for name, (number, shape) in ports(source).items():
        if "  # " in lines[number - 1]:
            shared = ""
        elif lines[number - 2].strip().startswith("# "):
            shared = shape
        elif shape != shared and not NAMED.search(shape):
            found.append(name)
    return found


def constructor(kind: type) -> str:
    """Source of a class's own constructor, or an inherited one."""
    return textwrap.dedent(inspect.getsource(kind.__init__))


@pytest.mark.parametrize("kind", COMPONENTS, ids=name_of)
def test_ports_are_listed_with_their_meaning(kind):
    source = constructor(kind)
    assert ports(source), "no ports"
    assert not undescribed(source)
    assert "Members:" not in kind.__doc__


@pytest.mark.parametrize("kind", COMPONENTS, ids=name_of)
def test_no_port_is_taken_from_another_part(kind):
    assert not re.search(r"ports.*signature|signature\.members(?!\[)", constructor(kind))


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


@pytest.mark.parametrize("kind", COMPONENTS, ids=name_of)
def test_parameters_exist(kind):
    assert entries(kind, "Parameters").keys() <= inspect.signature(kind.__init__).parameters.keys()


def test_internal_signals_exist():
    assert {kind for kind in COMPONENTS if entries(kind, "Internal")} == set(INTERNAL)
    for kind, make in INTERNAL.items():
        component = make()
        for name in entries(kind, "Internal"):
            assert hasattr(component, name), name


def test_all_components_are_found():
    assert len(COMPONENTS) > 80


LISTED = """
def __init__(self, format):
    ports = {
        "i": In(stream_of(point_record(config))),
        # codes of `format`
        "a": In(format.width),
        "b": In(format.width),
        "c": In(format.width),  # another
        # more than
        # one line
        "o": Out(4),
    }
    if format.small:
        ports["small"] = In(1)  # the item is small
    super().__init__(ports)
"""


def test_listed_ports_are_found():
    assert list(ports(LISTED)) == ["i", "a", "b", "c", "o", "small"]
    assert undescribed(LISTED) == []


@pytest.mark.parametrize(
    "old, new, found",
    [
        ("        # codes of `format`\n", "", ["a", "b"]),
        ('"b": In', '"b": Out', ["b"]),
        ("  # another", "", []),
        ('"b": In(format.width),', '"b": In(format.width),  # b', []),
        ('"a": In(format.width),', '"a": In(format.width),  # a', ["b"]),
        ("stream_of(point_record(config))", "4", ["i"]),
        ("  # the item is small", "", ["small"]),
        ("        # more than\n        # one line\n", "", ["o"]),
    ],
)
def test_missing_meanings_are_found(old, new, found):
    assert old in LISTED
    assert undescribed(LISTED.replace(old, new)) == found


class Right(wiring.Component):
    """A component for the tests below.

    Parameters:
        small: whether there is
            a port `small`
        a, b: others

    **Timing**: none.
    """


def test_entries():
    assert entries(Right, "Parameters") == {
        "small": "whether there is a port `small`", "a": "others", "b": "others"
    }  # fmt: skip
    assert entries(Right, "Internal") == {}


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("a, b: others", "a, small: others", "Wrong: a, small is listed twice"),
        ("small: whether", "small whether", "Wrong: no entry:     small whether there is"),
    ],
)
def test_malformed_lists_are_refused(old, new, message):
    assert old in Right.__doc__
    wrong = type("Wrong", (Right,), {"__doc__": Right.__doc__.replace(old, new)})
    with pytest.raises(AssertionError, match=re.escape(message)):
        entries(wrong, "Parameters")
