"""The exception for invalid input: files, arguments, scenes."""


class InputError(ValueError):
    """Invalid input. The message is one line that names the file (or argument) and the field.

    The command line prints it and exits with status 2, before anything is written.
    """
