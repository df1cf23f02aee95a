"""Names, numbers and colours that an option may have."""

from collections.abc import Collection, Iterable

from splatcore.spec.error import InputError


def check_known(option: str, known: Collection[str], *names: str):
    """Raise InputError for the first of an option's names that is not known."""
    for name in names:
        if name not in known:
            raise InputError(f"{option} '{name}': unknown; choose {choices(known)}")


def choices(names: Iterable[str]) -> str:
    """Return names as "a, b or c"."""
    *first, last = names
    return f"{', '.join(first)} or {last}" if first else last


def numbers(option: str, text: str, kind: type = float, blank: bool = False) -> tuple:
    """Parse numbers separated by commas; raise InputError for anything else.

    blank: leave out parts without text
    """
    try:
        return tuple(kind(part) for part in text.split(",") if part.strip() or not blank)
    except ValueError:
        raise InputError(f"{option} '{text}': must be numbers separated by commas") from None


def numbers_within(option: str, text: str, least: float, most: float, kind: type = float) -> tuple:
    """Parse numbers in least … most separated by commas; raise InputError for anything else."""
    found = numbers(option, text, kind)
    if not all(least <= number <= most for number in found):
        raise InputError(f"{option} '{text}': must all be in {least} … {most}")
    return found


def parse_colour(text: str) -> tuple[float, float, float]:
    """Parse three numbers 0 … 1 separated by commas."""
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--background '{text}': must be three numbers R,G,B") from None
    if not all(0 <= value <= 1 for value in (red, green, blue)):
        raise InputError(f"--background '{text}': is not in 0 … 1")
    return red, green, blue
