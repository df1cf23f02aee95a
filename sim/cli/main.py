"""The command line `splatcore`: bad input is one line and exit status 2."""

import sys
from importlib import import_module

import typer

from splatcore.sim.cli.options import app
from splatcore.sim.common.output import messages
from splatcore.spec.error import InputError

UsageError = typer.BadParameter.__mro__[1]  # of click, or of typer's own copy of it

COMMANDS = (
    "scene compress pack render compare error hard programs verilog sizes cycles power fit "
    "report bench_sort bench_views bench_rule bench_quality bench_compression bench_differentiable"
).split()
"""Files of this folder whose import registers commands, in help's order."""


def register(command: str = ""):
    """Import the command's own file, where it has one, else those of all: seconds."""
    for name in [command] if command in COMMANDS else COMMANDS:
        import_module(f"splatcore.sim.cli.{name}")


def main(arguments: list[str] | None = None):
    """Run the command line; bad input is one line on standard error and exit status 2."""
    register(*sys.argv[1:2] if arguments is None else ())
    try:
        status = app(arguments, standalone_mode=False)
    except InputError as error:
        refuse(str(error))
    except UsageError as error:
        refuse(usage(error))
    except MemoryError:
        refuse("memory exhausted; a smaller --size needs less")
    sys.exit(status or 0)


def refuse(text: str):
    """End with a line of error, if there is one to say, and status 2."""
    if text:
        messages.print(f"error: {text}", markup=False, soft_wrap=True)
    sys.exit(2)


def usage(error: UsageError) -> str:
    """What is wrong with the arguments, and whose help tells more; nothing if help was shown."""
    text = " ".join(error.format_message().removeprefix("Invalid value for ").split()).rstrip(".")
    return text and f"{text}; see {error.ctx.command_path} --help" if error.ctx else text


if __name__ == "__main__":
    main()
