"""Options as fields of dataclasses: the default, the help and the limits of each, once."""

from dataclasses import field

SCENE = "Scene and camera"
"""Heading of the options that say how a scene is read and viewed."""


def option(default: object, metavar: str | None, help: str, *names: str, panel: str, **limits):
    """Declare a field that is an option of every command with a parameter of the dataclass.

    metavar: placeholder for the value in --help; None: the type
    names: of the option; default: the field's
    panel: heading in --help
    limits: `min` and `max`
    """
    about = {"metavar": metavar, "help": help, "names": names, "panel": panel, "limits": limits}
    return field(default=default, metadata=about)
