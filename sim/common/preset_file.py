"""Writer of preset files; `spec.preset` reads them."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path

from splatcore.sim.common.output import write
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.preset import FLOATS


def write_preset(
    path: str | Path,
    config: Config,
    base: Config = DEFAULT,
    reasons: Mapping[str, str] | None = None,
    about: str = "",
):
    """Write the fields that differ from a built-in preset, each below its reason.

    reasons: text by field
    about: comment lines at the head of the file
    """
    write(path, preset_text(config, base, reasons or {}, about).encode())


def preset_text(config: Config, base: Config, reasons: Mapping[str, str], about: str = "") -> str:
    """Text of a preset file; parameters as in `write_preset`."""
    lines = [f"# {line}" for line in about.splitlines()]
    lines += [f"base = {_text(base.name)}", f"name = {_text(config.name)}"]
    for field in fields(Config):
        value = getattr(config, field.name)
        if field.name == "name" or value == getattr(base, field.name):
            continue
        lines.append("")
        if reason := reasons.get(field.name):
            lines.append(f"# {' '.join(reason.split())}")
        lines.append(f"{field.name} = {_text(value)}")
    return "\n".join(lines) + "\n"


def _text(value: object) -> str:
    """A field's value as TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, tuple):
        return f"[{', '.join(map(_text, value))}]"
    if is_dataclass(value):
        return next((f'"{name}"' for name, f in FLOATS.items() if f == value), _table(value))
    return repr(value)


def _table(value: object) -> str:
    """A dataclass's fields as a TOML table, without those at their defaults."""
    found = {field.name: getattr(value, field.name) for field in fields(value)}
    usual = {field.name: field.default for field in fields(value)}  # MISSING equals no value
    cells = [f"{name} = {_text(item)}" for name, item in found.items() if item != usual[name]]
    return f"{{ {', '.join(cells)} }}"
