"""The command line `splatcore`: bad input is one line and exit status 2."""

import sys
from importlib import import_module

from splatcore.sim.cli.options import app
from splatcore.sim.common.output import messages
from splatcore.spec.error import InputError

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
        app(arguments)
    except InputError as error:
        messages.print(f"error: {error}", markup=False, soft_wrap=True)
        sys.exit(2)
    except MemoryError:
        messages.print("error: memory exhausted; a smaller --size needs less", markup=False)
        sys.exit(2)


if __name__ == "__main__":
    main()
