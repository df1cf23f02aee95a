"""The way of a scene through a command: functions that it passes through, and their files.

A function counts if it is given, or returns, a scene, its Gaussians, its packed model or a value
that holds one; the methods of such a value do not.

`python -m tb.helpers.way render garden --size 64x64 -o a.png` runs a command and prints them.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene

ROOT = Path(__file__).parents[2]
CARRIED = (Scene, Gaussians, PackedModel)


def carries(value: object, depth: int = 3) -> bool:
    """Return whether a value is a scene, its Gaussians or its model, or holds one."""
    if isinstance(value, CARRIED):
        return True
    if isinstance(value, tuple | list):
        return any(carries(each, depth - 1) for each in value[:4])
    if not (depth and type(value).__module__.startswith("splatcore.")):
        return False
    return any(carries(each, depth - 1) for each in getattr(value, "__dict__", {}).values())


@contextmanager
def followed() -> Iterator[dict[tuple[str, str], None]]:
    """Yield (file, function) of this repository through which a scene passes, in order."""
    found: dict[tuple[str, str], None] = {}
    names: dict[object, tuple[str, str] | None] = {}

    def name_of(code) -> tuple[str, str] | None:
        path = Path(code.co_filename).resolve()
        if code.co_name.startswith("<") or not path.is_relative_to(ROOT):
            return None
        return str(path.relative_to(ROOT)), code.co_qualname

    def visit(frame, event: str, value: object):
        code = frame.f_code
        if code not in names:
            names[code] = name_of(code)
        if (key := names[code]) is None or key in found or event not in ("call", "return"):
            return
        values = [value]
        if event == "call":
            given, count = frame.f_locals, code.co_argcount + code.co_kwonlyargcount
            values = [given.get(name) for name in code.co_varnames[:count]]
        if carries(frame.f_locals.get("self")):
            names[code] = None
        elif any(carries(each) for each in values):
            found[key] = None

    sys.setprofile(visit)
    try:
        yield found
    finally:
        sys.setprofile(None)


if __name__ == "__main__":
    from splatcore.app.cli.main import main

    sys.argv[0] = "splatcore"
    with followed() as way, suppress(SystemExit):
        main()
    for file, name in way:
        print(f"{file} {name}")
    print(len(way), "functions in", len({file for file, _ in way}), "files")
