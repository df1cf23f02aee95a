"""Measurements for campaigns in tests, in a file that is quick to import in processes."""

import os


def double(number: int, log: str) -> dict:
    """A measurement that logs each of its runs."""
    with open(log, "a") as file:
        file.write(f"{number}\n")
    if number < 0:
        raise ValueError(f"{number} is negative")
    return {"value": 2 * number}


def die(number: int, log: str) -> dict:
    """A measurement that ends its process."""
    os._exit(1)


def crash(number: int, log: str) -> dict:
    """A measurement whose process is killed by signal `number`."""
    os.kill(os.getpid(), number)


def say(text: str):
    """A measurement that prints a message."""
    from splatcore.sim.common.output import messages

    messages.print(text)
