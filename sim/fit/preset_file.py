"""Writing preset files, which `spec.preset` reads."""

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
    """Write what differs from a preset that is built in, each field under the reason for it.

    reasons: by field; about: lines at the head.
    """
    write(path, preset_text(config, base, reasons or {}, about).encode())


def preset_text(config: Config, base: Config, reasons: Mapping[str, str], about: str = "") -> str:
    """The text of that file."""
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
    """A field's value in TOML."""
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
    """A dataclass's fields but those that are as they are by default."""
    found = {field.name: getattr(value, field.name) for field in fields(value)}
    usual = {field.name: field.default for field in fields(value)}  # which nothing is without one
    cells = [f"{name} = {_text(item)}" for name, item in found.items() if item != usual[name]]
    return f"{{ {', '.join(cells)} }}"
