"""Measurements for campaigns in tests; processes import this file, which is quick."""

import os


def double(number: int, log: str) -> dict:
    """A measurement that says how often it was made."""
    with open(log, "a") as file:
        file.write(f"{number}\n")
    if number < 0:
        raise ValueError(f"{number} is negative")
    return {"value": 2 * number}


def die(number: int, log: str) -> dict:
    """A measurement that takes its process with it."""
    os._exit(1)


def crash(number: int, log: str) -> dict:
    """A measurement whose process ends by the signal of that number."""
    os.kill(os.getpid(), number)


def say(text: str):
    """A measurement that tells its progress."""
    from splatcore.sim.common.output import messages

    messages.print(text)
