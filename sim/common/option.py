"""Options and arguments of commands: the default, the help and the limits of each, once.

They are the defaults of a command's parameters, or fields of a dataclass that commands share.
"""

from collections.abc import Callable
from dataclasses import field
from typing import Any

SCENE = "Scene and camera"
"""Heading of the options that say how a scene is read and viewed."""


def option(
    default: object, metavar: str | None, help: str, *names: str, panel: str | None = None,
    read: Callable[[str], object] | None = None, **limits,
) -> Any:  # fmt: skip
    """Declare an option; its type is the parameter's or field's, `Path` for an output.

    default: its value without the option; `...` if it must be given
    metavar: placeholder for the value in --help; None: the type
    names: of the option; default: the parameter's
    panel: heading in --help; None: "Options"
    read: makes the parameter's value of the text; raises InputError
    limits: `min` and `max`
    """
    about = {"metavar": metavar, "help": help, "rich_help_panel": panel, **limits}
    return field(default=default, metadata={"names": names, "about": about, "read": read})


def argument(default: object, metavar: str, help: str) -> Any:
    """Declare an argument, like an option."""
    return field(default=default, metadata={"about": {"metavar": metavar, "help": help}})
