"""The one exception for bad input from outside: files, arguments, scenes."""


class InputError(ValueError):
    """Bad input. The message is one line that names the file (or argument) and the field.

    The command line prints it and exits with status 2; nothing has been written by then.
    """
