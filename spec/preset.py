"""Presets by name, or from a TOML file: `base`, `name`, then fields of `Config` by name.

base = "DEFAULT"     # preset with the other fields' values; DEFAULT if left out
name = "mine"        # letters, digits, _ and -; the file's name if left out
rasterizers = 2
arithmetic = "FP16"  # or a table of `Float`'s fields:
depth = { exponent = 7, fraction = 14, signed = false, subnormal = false }
sort_digits = [3, 4, 4, 4]
"""

import difflib
import re
import tomllib
from collections.abc import Iterable
from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from types import UnionType
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np

from splatcore.spec.config import DEFAULT, FORMATS, PRESETS, Config
from splatcore.spec.error import InputError
from splatcore.spec.memory import compact_degrees, harmonics_bytes, model_format
from splatcore.spec.number import FP16, FP24, Float

SUFFIX = ".toml"
"""Suffix of a preset's file."""

FLOATS = {"FP16": FP16, "FP24": FP24}
"""Formats that a file may name."""

EXPONENT_BITS, FRACTION_BITS = (5, 8), (8, 17)
"""Minimum and maximum bits of `Config.arithmetic`'s exponent and fraction."""

PES_MIN = 2
"""With fewer PEs, colours would be needed before they can be looked up."""


def find_preset(text: str) -> Config:
    """Return the preset of a name, in upper or lower case, or of a file.

    Raises InputError if neither exists. Names come first: write ./NAME for a file with a preset's
    name.
    """
    if text.upper() in PRESETS:
        return PRESETS[text.upper()]
    if Path(text).exists() or text.lower().endswith(SUFFIX):
        return read_preset(text)
    known = f"{', '.join(PRESETS)}, or a file like machine{SUFFIX}"
    raise InputError(f"preset '{text}': unknown; choose {known}")


def read_preset(path: str | Path) -> Config:
    """Return the machine of a TOML file; raise InputError, naming file and key, if invalid."""
    table = read_table(path)
    if not table:
        raise InputError(f"{path}: is empty; a preset sets at least one field")
    hints = get_type_hints(Config)
    check_keys(str(path), table, ("base", *hints))
    base = table.pop("base", DEFAULT.name)
    if not isinstance(base, str) or base.upper() not in PRESETS:
        raise InputError(f"{path}: base {base!r} is unknown; choose one of {', '.join(PRESETS)}")
    table.setdefault("name", re.sub(r"[^A-Za-z0-9_-]", "_", Path(path).stem))
    values = {key: typed(hints[key], table[key], f"{path}: {key}") for key in table}
    name = values["name"]
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise InputError(f"{path}: name {name!r} may only have letters, digits, _ and -")
    if name.upper() in PRESETS:
        raise InputError(f"{path}: name {name!r} is the name of a built-in preset")
    try:
        config = replace(PRESETS[base.upper()], **values)
        check_buildable(config)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return config


def read_table(path: str | Path) -> dict:
    """Return a TOML file's table; raise InputError, naming the file, if it has none."""
    try:
        return tomllib.loads(Path(path).read_bytes().decode())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path}: is not TOML: {error or 'nested too deeply'}") from None


def changed(config: Config, values: dict[str, object], name: str = "own") -> Config:
    """Return a machine named `name` with other values of some fields.

    Raises InputError, naming the field, for an unknown field, a value of another type, or a machine
    that cannot be built.
    """
    hints = {key: hint for key, hint in get_type_hints(Config).items() if key != "name"}
    check_keys("preset", values, hints)
    plain = {key: v.item() if isinstance(v, np.generic) else v for key, v in values.items()}
    found = {key: typed(hints[key], value, f"preset: {key}") for key, value in plain.items()}
    made = replace(config, name=name, **found)
    check_buildable(made)
    return made


def check_buildable(config: Config):
    """Raise InputError, naming a field, for number formats that the hardware cannot have."""

    def refuse(field: str, why: str):
        raise InputError(f"preset {config.name}: {field} {why}")

    arithmetic = config.arithmetic
    bits = {
        "arithmetic's exponent": (arithmetic.exponent, EXPONENT_BITS),
        "arithmetic's fraction": (arithmetic.fraction, FRACTION_BITS),
    } | {name: (getattr(config, name), about.limits) for name, about in FORMATS.items()}
    for name, (value, (low, high)) in bits.items():
        if not low <= value <= high:
            refuse(name, f"{value} is not in {low} … {high}")
    bounds = {name: (about.bounds, about.beyond) for name, about in FORMATS.items() if about.bounds}
    for name, (large, beyond) in (bounds | {"burst": (("page",), 0)}).items():
        most = sum(getattr(config, field) for field in large) + beyond
        if (value := getattr(config, name)) > most:
            refuse(name, f"{value} is above {most}, the limit set by {large[0]}")
    if not arithmetic.signed:
        refuse("arithmetic", "must be signed")
    if config.pes * config.pe_arrays < PES_MIN:
        refuse("pes", f"{config.pes} in {config.pe_arrays} arrays are fewer than {PES_MIN}")
    for degree in compact_degrees(config):
        try:
            format = model_format(config, degree)
            wanted = format.attribute_record and format.codebook_bytes
        except ValueError as error:
            refuse("colour_index or sh_index", f"do not fit: {error}")
        if wanted > config.codebook:
            refuse("codebook", f"{config.codebook} bytes are below the {wanted} of degree {degree}")
    harmonics = harmonics_bytes(config)
    if harmonics > config.codebook:
        slots = config.projection_slots
        refuse("codebook", f"{config.codebook} bytes are below the {harmonics} of {slots} slots")


def check_keys(where: str, table: dict, known: Iterable[str]):
    """Raise InputError for an unknown key, and suggest a similar one."""
    known = tuple(known)
    for key in table:
        if key not in known:
            close = difflib.get_close_matches(key, known, 1)
            hint = f"; did you mean '{close[0]}'?" if close else ""
            raise InputError(f"{where}: unknown key '{key}'{hint} (known: {', '.join(known)})")


def typed(hint, value, where: str):
    """Convert a value of TOML or Python to a field's type; raise InputError, naming the field."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Literal:
        if not isinstance(value, str) or value not in arguments:
            raise InputError(f"{where}: {value!r} is not one of {', '.join(map(str, arguments))}")
        return value
    if origin in (tuple, UnionType):  # any number of elements of one type; `Faint`'s are integers
        if not isinstance(value, list | tuple):
            raise InputError(f"{where}: {value!r} is not an array")
        inner = arguments[0] if origin is tuple else int
        return tuple(typed(inner, item, f"{where}[{k}]") for k, item in enumerate(value))
    if is_dataclass(hint):
        if hint is Float and isinstance(value, str) and value in FLOATS:
            return FLOATS[value]
        if isinstance(value, hint):
            return value
        return _dataclass(hint, value, where)
    if hint is float and type(value) is int:
        return float(value)
    if type(value) is not hint:
        raise InputError(f"{where}: {value!r} is not {NAMES.get(hint, hint)}")
    return value


NAMES = {int: "an integer", bool: "true or false", str: "a string", float: "a number"}
"""Types in messages."""


def _dataclass(kind: type, value, where: str):
    """Return a dataclass from an inline table of its fields."""
    if not isinstance(value, dict):
        some = f" nor one of {', '.join(FLOATS)}" if kind is Float else ""
        raise InputError(f"{where}: {value!r} is not a table of {kind.__name__}'s fields{some}")
    hints = get_type_hints(kind)
    check_keys(where, value, hints)
    for field in fields(kind):
        if field.name not in value and field.default is MISSING:
            raise InputError(f"{where}: '{field.name}' is missing")
    found = {key: typed(hints[key], item, f"{where}.{key}") for key, item in value.items()}
    try:
        return kind(**found)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
