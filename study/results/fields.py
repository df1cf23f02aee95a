"""Fields of results: each says what its value means, in which unit, and how it is shown.

From the fields of a dataclass follow the columns of tables, the tables kept in docs/results, the
keys in docs/json.md, and the samples of tests. A field is one of

    item(…)       a number, text or list
    part(…)       an object, of another dataclass or with known keys
    table(…)      a list or dict of objects of another dataclass, one row of a table each
    errors(…)     PSNR, SSIM and largest error of a picture against each of several truths
"""

from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from inspect import get_annotations
from itertools import product
from types import UnionType
from typing import Any, NamedTuple, get_args, get_origin

from splatcore.sim.common.table import NONE, Column

LEVELS = 255  # steps of an 8-bit channel


@dataclass(frozen=True)
class Value:
    """The meaning of a field.

    meaning: for docs/json.md
    title, unit, digits, per, none: of its column; see `Column`
    keys: of an object of numbers
    maybe: the key may be missing
    kept: in docs/results; for an object, also which of its keys
    end: of a list or dict of rows: end of its table's name; None: the rows have no own table
    index: column for the index of a list or the key of a dict
    examples: values in samples
    """

    meaning: str = ""
    title: str = ""
    unit: str = ""
    digits: int | None = None
    per: float = 1
    none: str = NONE
    keys: tuple[str, ...] = ()
    maybe: bool = False
    kept: bool | str = True
    end: str | None = None
    index: str = ""
    examples: tuple = ()


def item(meaning: str = "", unit: str = "", digits: int | None = None, **more) -> Any:
    """A field of a result; see `Value`."""
    return made_of(Value(meaning, unit=unit, digits=digits, **more))


def made_of(about: Value) -> Field:
    """A field with this meaning."""
    return field(default=... if about.maybe else MISSING, metadata={"value": about})


part = item


def table(meaning: str, end: str | None = "", index: str = "", **more) -> Any:
    """A list or dict of objects, kept as a table."""
    return item(meaning, end=end, index=index, **more)


METRICS = {
    "psnr_db": Value(title="PSNR", unit="dB", digits=2, none="exact", examples=(55.5,)),
    "ssim": Value(title="SSIM", digits=5, examples=(0.999,)),
    "max_error": Value(
        title="max error", unit=f"of {LEVELS}", digits=0, per=1 / LEVELS, examples=(2 / LEVELS,)
    ),
}


class Errors(NamedTuple):
    """PSNR, SSIM and largest error of a picture against several truths: three fields for each."""

    truths: tuple[str, ...]
    changes: dict


def errors(*truths: str, meaning: str = "as above", **more) -> Any:
    """See `Errors`; more: of each field."""
    return Errors(truths, {"meaning": meaning, **more})


def result(made: type) -> type:
    """Make a dataclass of a result; its fields are passed by name."""
    kinds = {}
    for name, inside in get_annotations(made).items():
        found = vars(made).get(name)
        if not isinstance(found, Errors):
            kinds[name] = inside
            continue
        delattr(made, name)
        for truth, metric in product(found.truths, METRICS):
            more = found.changes | {"title": f"{METRICS[metric].title}, {truth}"}
            kinds[f"{metric}_{truth}"] = float | None
            setattr(made, f"{metric}_{truth}", made_of(replace(METRICS[metric], **more)))
    made.__annotations__ = kinds
    return dataclass(kw_only=True)(made)


def facts(found: object) -> object:
    """A result as JSON-like objects; fields without a value are left out."""
    if is_dataclass(found):
        pairs = ((each.name, getattr(found, each.name)) for each in fields(found))
        return {name: facts(item) for name, item in pairs if item is not ...}
    if isinstance(found, dict):
        return {key: facts(item) for key, item in found.items()}
    return [facts(item) for item in found] if isinstance(found, list | tuple) else found


def about(each: Field) -> Value:
    """The meaning of a field."""
    return each.metadata["value"]


def kind(each: Field | type) -> Any:
    """A field's type without None."""
    found = each.type if isinstance(each, Field) else each
    if isinstance(found, UnionType) or get_origin(found) is UnionType:
        known = [one for one in get_args(found) if one is not type(None)]
        return known[0] if len(known) == 1 else found
    return found


def is_text(found: Any) -> bool:
    """Whether values of a type are text."""
    return found is str or str in get_args(found)


class Leaf(NamedTuple):
    """A value in a result: its dotted key, its type, its field's `Value`, whether it is kept."""

    key: str
    kind: Any
    about: Value
    kept: bool


def leaves(schema: type, above: str = "", kept: bool = True, maybe: bool = False) -> Iterator[Leaf]:
    """Yield the values of an object, without those of its lists and dicts of objects."""
    for each in fields(schema):
        found, inside, key = about(each), kind(each), f"{above}{each.name}"
        stays = kept and bool(found.kept)
        found = replace(found, maybe=found.maybe or maybe)
        if get_origin(inside) in (list, dict) and items_of(inside):
            continue
        if is_dataclass(inside):
            below = leaves(inside, f"{key}.", stays, found.maybe or kind(each) is not each.type)
        elif found.keys:
            below = (
                Leaf(f"{key}.{name}", (get_args(inside) or (int,))[-1], found, stays)
                for name in found.keys
            )
        else:
            below = [Leaf(key, inside, found, stays)]
        only = {f"{key}.{name}" for name in found.kept.split()} if found.kept not in (1, 0) else ()
        for leaf in below:
            yield leaf._replace(kept=leaf.kept and (not only or leaf.key in only))


def items_of(inside: Any) -> type | None:
    """The dataclass of the objects in a list or dict, at any depth; None if there are none."""
    while get_origin(inside) in (list, dict):
        inside = kind(get_args(inside)[-1])
    return inside if is_dataclass(inside) else None


class Step(NamedTuple):
    """One level of the place of a table's rows.

    key: dotted
    bracket: `[` for a list, `{` for a dict
    column: for the list's index or the dict's key; empty: no column
    """

    key: str
    bracket: str
    column: str


class Sheet(NamedTuple):
    """A table of a result: the place of its rows, their dataclass, and the end of its name."""

    place: tuple[Step, ...]
    schema: type
    end: str

    @property
    def kept(self) -> list[Leaf]:
        """The values that are kept."""
        return [leaf for leaf in leaves(self.schema) if leaf.kept]

    @property
    def columns(self) -> list[str]:
        """Headings: the place's own columns, then the kept values."""
        *outer, last = self.place
        own = [step.column for step in (*outer, *([last] if last.bracket == "{" else []))]
        return [*filter(None, own), *(leaf.key for leaf in self.kept)]


def sheets(schema: type, place: tuple[Step, ...] = (), above: str = "") -> Iterator[Sheet]:
    """Yield the kept tables of a result, outer ones first."""
    for each in fields(schema):
        found, inside, key = about(each), kind(each), f"{above}{each.name}"
        if not found.kept:
            continue
        if is_dataclass(inside):
            yield from sheets(inside, place, f"{key}.")
        if (row := items_of(inside)) is None or get_origin(inside) not in (list, dict):
            continue
        down, index = list(place), found.index
        while get_origin(inside) in (list, dict):
            down.append(Step(key, "{" if get_origin(inside) is dict else "[", index))
            inside, key, index = kind(get_args(inside)[-1]), "", ""
        if found.end is not None:
            yield Sheet(tuple(down), row, found.end)
        yield from sheets(row, tuple(down))


def columns(schema: type, keys: str) -> list[Column]:
    """Columns of tables, of the fields with these dotted keys."""
    known = {leaf.key: leaf.about for leaf in leaves(schema)}
    found = ((key, known[key]) for key in keys.split())
    return [
        Column(
            each.title or key.rpartition(".")[2].replace("_", " "), each.unit, each.digits,
            each.none, get=key, per=each.per, maybe=each.maybe,
        )
        for key, each in found
    ]  # fmt: skip


def with_names(key: str, found: dict[str, dict]) -> Iterator[dict]:
    """The objects of a dict, each with its name under `key`."""
    return ({key: name} | dict(each) for name, each in found.items())
