"""Faults in the source of hardware: changes of one line, for `tb.planted.mutate`."""

import ast
import inspect
import random
import textwrap
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import pytest

OPERATORS = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Lt: ast.LtE,
    ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
}  # fmt: skip

HANDSHAKES = ("valid", "ready", "enable", "en")  # names of handshake signals

KINDS = ("operator", "constant", "index", "condition", "handshake")


@dataclass(frozen=True)
class Fault:
    """A change of a file. text: the whole changed file."""

    file: str
    kind: str
    line: int
    before: str
    after: str
    text: str

    def __str__(self) -> str:
        return f"{self.kind:9} hdl/{self.file}.py:{self.line}: {self.before} → {self.after}"


def draw(sources: dict[str, str], count: int, seed: int) -> list[Fault]:
    """Draw `count` faults (or all): files take turns, and within a file the kinds of faults.

    sources: text of files by name
    The order of a file's faults depends only on the seed, its name and its faults.
    """
    queues = []
    for name in sorted(sources):
        rng = random.Random(f"{seed} {name}")
        by_kind = {kind: [] for kind in KINDS}
        for fault in faults(name, sources[name]):
            by_kind[fault.kind].append(fault)
        for group in by_kind.values():
            rng.shuffle(group)
        queue = []
        while any(by_kind.values()):
            queue += [group.pop() for group in by_kind.values() if group]
        queues.append(queue)
    drawn = [queue[k] for k in range(max(map(len, queues))) for queue in queues if k < len(queue)]
    return drawn[:count]


def faults(name: str, text: str) -> Iterator[Fault]:
    """All possible faults of a file."""
    tree = ast.parse(text)
    for function in ast.walk(tree):
        # Constructors have widths and ports, but no logic.
        if isinstance(function, ast.FunctionDef) and function.name != "__init__":
            for node in ast.walk(function):
                for kind, old, new in changes(node):
                    yield _fault(name, text, kind, old, new)


def changes(node: ast.AST) -> Iterator[tuple[str, ast.expr, str]]:
    """Changes of a node: kind, the expression to replace, its replacement."""
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        other = ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right)
        yield "operator", node, f"({ast.unparse(other)})"
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPERATORS:
        other = ast.Compare(node.left, [OPERATORS[type(node.ops[0])]()], node.comparators)
        yield "operator", node, f"({ast.unparse(other)})"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Invert):
        yield "operator", node, f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        yield from _call(node)
    elif isinstance(node, ast.Subscript):
        whole = not isinstance(node.slice, ast.Slice)
        for part in (node.slice,) if whole else (node.slice.lower, node.slice.upper):
            name = ast.Constant | ast.JoinedStr  # name of a field: has no neighbour
            if part is not None and not isinstance(part, name | ast.Slice | ast.Tuple):
                yield "index", part, f"({ast.unparse(part)}) - 1"
            elif isinstance(part, ast.Constant) and isinstance(part.value, int):
                yield "index", part, str(part.value + 1)


def _call(node: ast.Call) -> Iterator[tuple[str, ast.expr, str]]:
    """Changes of conditions and of assigned values."""
    if node.func.attr in ("If", "Elif") and node.args:
        yield "condition", node.args[0], "1"
    elif node.func.attr == "eq" and len(node.args) == 1:
        [value] = node.args
        target = node.func.value
        if isinstance(target, ast.Attribute) and target.attr in HANDSHAKES:
            if not isinstance(value, ast.Constant):
                yield "handshake", value, "1"
        elif isinstance(value, ast.Constant) and isinstance(value.value, int):
            yield "constant", value, str(value.value ^ 1)


def _fault(name: str, text: str, kind: str, old: ast.expr, new: str) -> Fault:
    lines = text.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line.encode()))
    begin = starts[old.lineno - 1] + old.col_offset
    end = starts[old.end_lineno - 1] + old.end_col_offset
    data = text.encode()
    changed = (data[:begin] + new.encode() + data[end:]).decode()
    before = " ".join(ast.unparse(old).split())
    return Fault(name, kind, old.lineno, before, new, changed)


def each(faults: Iterable[str]) -> list:
    """Faults as parameters of a test: the first for `make test`, the others for `make verify`."""
    marks = [(), *[pytest.mark.verify] * len(list(faults))]
    return [pytest.param(name, marks=mark) for name, mark in zip(faults, marks, strict=False)]


def planted_in(part: type, **methods: dict[str, tuple[str, str]]) -> dict[str, tuple]:
    """A table of faults by name: class, method, text to replace in the method, new text.

    methods: by name of the method, texts by fault
    """
    return {
        name: (part, method, *texts)
        for method, all in methods.items()
        for name, texts in all.items()
    }


def planted(method: Callable, old: str, new: str) -> Callable:
    """A method with a part of its source replaced, for proofs and tests that must fail."""
    source = textwrap.dedent(inspect.getsource(method))
    assert source.count(old) == 1
    scope = dict(method.__globals__)
    exec(source.replace(old, new), scope)
    return scope[method.__name__]


def plant(monkeypatch, part: type, method: str, old: str, new: str):
    """Replace a part's method by `planted` for the rest of a test."""
    monkeypatch.setattr(part, method, planted(getattr(part, method), old, new))
