"""The command line `splatcore`. Bad input prints one line of error and exits with status 2."""

import sys
from importlib import import_module

import typer

from splatcore.app.cli.commands import COMMANDS, GONE, GROUPS
from splatcore.app.cli.options import app, command
from splatcore.sim.common import notes
from splatcore.sim.common.output import messages
from splatcore.spec.error import InputError
from splatcore.spec.progress import raise_again

UsageError = typer.BadParameter.__mro__[1]  # of click, or of typer's own copy of it


def register(words: list[str] | None = None):
    """Import the module of one command, or of all commands.

    words: a command line; None: all commands

    Words that name no command (a request for help, or a mistake) need no import: the names and
    summaries of all commands are registered, in a tenth of the time.
    """
    name = " ".join((words or [])[: 2 if words and words[0] in GROUPS else 1])
    if words is None or name in COMMANDS:
        for each in [name] if name else COMMANDS:
            import_module(f"splatcore.app.cli.{COMMANDS[each].file}")
        return
    for name, entry in COMMANDS.items():
        command(name, help=entry.summary)(lambda: None)


INTERRUPTED = 130  # exit status after Ctrl-C: 128 + SIGINT


def main(arguments: list[str] | None = None):
    """Run the command line; bad input prints one line on standard error and exits with status 2, an
    interrupt one and exits with status 130."""
    raise_again()
    try:
        status = run(arguments)
    except KeyboardInterrupt:
        status = INTERRUPTED
    if status == INTERRUPTED:
        messages.print("interrupted")
    sys.exit(status)


def run(arguments: list[str] | None) -> int:
    """Run the command line and return its exit status; bad input exits with status 2."""
    words = sys.argv[1:] if arguments is None else arguments
    for name in (" ".join(words[:count]) for count in (1, 2)):
        if name in GONE:
            refuse(f"{name}: this command was removed; {GONE[name]}")
    register(words if arguments is None else None)
    try:
        with notes.printing():
            status = app(arguments, standalone_mode=False)
    except InputError as error:
        refuse(str(error))
    except UsageError as error:
        refuse(usage(error))
    except MemoryError:
        refuse("out of memory; try a smaller --size")
    return status or 0


def refuse(text: str):
    """Print an error, unless it is empty, and exit with status 2."""
    if text:
        messages.print(f"error: {text}", soft_wrap=True)
    sys.exit(2)


def usage(error: UsageError) -> str:
    """Return a one-line message for a usage error; empty if help was printed."""
    option, command = getattr(error, "option_name", ""), getattr(error.ctx, "info_name", "")
    if found := GONE.get(f"{command} {option}"):
        return f"{option}: this option was removed from {command}; {found}"
    text = " ".join(error.format_message().removeprefix("Invalid value for ").split()).rstrip(".")
    return text and f"{text}; see {error.ctx.command_path} --help" if error.ctx else text


if __name__ == "__main__":
    main()
