"""The page docs/commands.md, made from the help: `python -m splatcore.app.cli.reference`."""

import re
from collections import Counter
from collections.abc import Iterator
from textwrap import fill

import typer

from splatcore.app.cli.commands import COMMANDS, PURPOSES, example
from splatcore.app.cli.main import register
from splatcore.app.cli.options import app, flowing

WIDTH = 100
"""Characters per line of the page."""

SHARED = 6
"""An option of at least this many commands is described once, for all of them."""

COMMON = "#options-of-many-commands"
"""Link to that section."""

HEAD = """# Which command does what, and with which options?

All commands of `splatcore`, from their `--help`; `make commands` writes this page. Find a command
by its purpose, then read its section; [options of many commands](#options-of-many-commands) are at
the end. Words in capital letters stand for values: SCENE is a scene file (3DGS PLY, compressed PLY,
SPZ, glTF, USD, .splat, KSPLAT, SOG) or folder (SOG), the output folder of INRIA's training, or the
name of a generated scene, MODEL a packed model (.splatcore), DIR a folder.
"""


def page() -> str:
    """Return the page."""
    register()
    commands = dict(all_commands(typer.main.get_command(app)))
    every = [each for name in COMMANDS for each in commands[name].params]  # in any order of import
    common = shared_options(every)
    parts = [HEAD, *index()]
    for purpose in PURPOSES:
        names = [name for name, entry in COMMANDS.items() if entry.purpose == purpose]
        parts += [section(name, commands[name], common) for name in names]
    parts.append("## Options of many commands\n")
    parts += panels([each for each in every if described(each) in common])
    return "\n".join(parts)


def shared_options(parameters: list) -> set[str]:
    """Return the descriptions of options that many commands share, one per name."""
    options = [each for each in parameters if is_option(each) and not each.required]
    counts: dict[str, Counter] = {}
    for each in options:
        counts.setdefault(each.opts[0], Counter())[described(each)] += 1
    most = (count.most_common(1)[0] for count in counts.values())
    return {text for text, count in most if count >= SHARED}


def is_option(parameter) -> bool:
    """Return whether a parameter is an option, not an argument."""
    return parameter.opts[0].startswith("-")


def all_commands(group, *words: str) -> Iterator[tuple[str, typer.core.TyperCommand]]:
    """Yield the commands of a group and its subgroups by name."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from all_commands(command, *words, name)
        else:
            yield " ".join((*words, name)), command


def index() -> Iterator[str]:
    """Yield the list of commands by purpose."""
    for purpose in PURPOSES:
        yield f"**{purpose}**\n"
        for name, entry in COMMANDS.items():
            if entry.purpose == purpose:
                link = f"[`{name}`](#splatcore-{name.replace(' ', '-')})"
                yield f"- {link}: {entry.summary}"
        yield ""


def section(name: str, command: typer.core.TyperCommand, common: set[str]) -> str:
    """Return the section of a command; common: descriptions of options for all commands."""
    text = "\n\n".join(wrapped(plain(part)) for part in flowing(command.help).split("\n\n"))
    head = f"## `splatcore {name}`\n\n{text}\n\n```sh\n{example(name)}\n```\n"
    own = [each for each in command.params if described(each) not in common]
    others = [f"`{each.opts[0]}`" for each in command.params if described(each) in common]
    parts = [head, *panels(own)]
    if others:
        parts.append(wrapped(f"And of [many commands]({COMMON}): {', '.join(others)}") + "\n")
    return "\n".join(parts)


def panels(parameters: list) -> list[str]:
    """Return lists of arguments and options, one per heading of the help."""
    headings: dict[str, dict[str, None]] = {}
    for each in parameters:
        heading = each.rich_help_panel or ("Options" if is_option(each) else "Arguments")
        headings.setdefault(heading, {})[wrapped(f"- {described(each)}", "  ")] = None
    order = sorted(headings.items(), key=lambda item: item[0] not in ("Arguments", "Options"))
    return [f"*{heading}*\n\n" + "\n".join(lines) + "\n" for heading, lines in order]


def wrapped(text: str, indent: str = "") -> str:
    """Wrap a text at spaces; indent: of all lines except the first."""
    lines = {"subsequent_indent": indent, "break_long_words": False, "break_on_hyphens": False}
    return fill(text, WIDTH, **lines)


def described(parameter) -> str:
    """Return the description of an argument or option as Markdown."""
    names = [*parameter.opts, *parameter.secondary_opts]
    if not names[0].startswith("-"):
        usage = f"`{parameter.metavar}`"
    elif getattr(parameter, "is_flag", False):
        usage = ", ".join(f"`{name}`" for name in names)
    else:
        usage = ", ".join(f"`{name} {parameter.metavar}`" for name in names)
    notes = ["required"] * parameter.required + limits(parameter) + default(parameter)
    condition = f" ({', '.join(notes)})" if notes else ""
    return f"{usage}{condition}: {plain(parameter.help)}"


def limits(parameter) -> list[str]:
    """Return the range of an option's value as text, if it has one."""
    places = parameter, getattr(parameter, "type", None)  # by version of typer
    low, high = (
        next((found for each in places if (found := getattr(each, name, None)) is not None), None)
        for name in ("min", "max")
    )
    if low is None:
        return []
    return [f"from {low:g}" if high is None else f"{low:g} … {high:g}"]


def default(parameter) -> list[str]:
    """Return the default of an option as text, if its help does not state one."""
    value = parameter.default
    if value is True:
        return [f"default `{parameter.opts[0]}`"]
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        return []
    return [f"default {value:g}" if isinstance(value, float) else f"default {value}"]


def plain(text: str) -> str:
    """Escape the characters of a help text that Markdown would interpret."""
    return re.sub(r"([*<>])", r"\\\1", text)


if __name__ == "__main__":
    print(page(), end="")
