"""Names that an option may have."""

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
