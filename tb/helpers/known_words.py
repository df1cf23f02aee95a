"""Commands and options in a text, against those of the command line."""

import re

import typer

from splatcore.app.cli.main import register
from splatcore.app.cli.options import app


def unknown_words(words: list[str]) -> list[str]:
    """Commands and options that the command line does not have."""
    register()
    command = typer.main.get_command(app)
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        if words[0] not in command.commands:
            return words[:1]
        command, words = command.commands[words[0]], words[1:]
    known = {
        name
        for parameter in command.params
        for name in (*parameter.opts, *parameter.secondary_opts)
    }
    return [
        word
        for word in words
        if re.match(r"--?[a-z]", word) and word.split("=")[0] not in {*known, "-h", "--help"}
    ]
