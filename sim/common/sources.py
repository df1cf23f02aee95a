"""The code that a result comes from: a function's module and all that it imports of Splatcore."""

import ast
import hashlib
import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

PACKAGE = "splatcore"
ROOT = Path(__file__).parents[2]  # the folder of the package's rooms


@cache
def code_key(source: Callable | ModuleType) -> str:
    """A key for all code that a function or module depends on, to be part of its results' keys."""
    return files_key(Path(inspect.getsourcefile(source)))


def files_key(path: Path, root: Path = ROOT) -> str:
    """The hash of the files of a `closure`.

    It changes with a comment, too: a result is measured again rather than kept by mistake.
    """
    text = hashlib.sha256()
    for file in sorted(closure(path, root)):
        text.update(f"{file.name}\0".encode() + file.read_bytes())
    return text.hexdigest()


def closure(path: Path, root: Path = ROOT) -> set[Path]:
    """A Python file and what it imports of the package, directly and through others.

    With a module come the `__init__.py` of its packages, and of the last one all files that are no
    Python, as it may read them. root: the folder of the package's rooms.
    """
    found, waiting = set(), [path]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found.add(path)
        waiting += imported(path, root)
        if path.is_relative_to(root):
            files = (file for file in path.parent.glob("[!.]*") if file.is_file())
            found |= {file for file in files if not file.suffix.startswith(".py")}
            between = path.relative_to(root).parents
            waiting += [init for part in between if (init := root / part / "__init__.py").is_file()]
    return found


def imported(path: Path, root: Path) -> Iterator[Path]:
    """Files of the modules that a Python file imports of the package, at any depth of its text."""
    for name in import_names(path.read_text()):
        if name.startswith(f"{PACKAGE}."):
            module = root.joinpath(*name.split(".")[1:])
            files = module.with_suffix(".py"), module / "__init__.py"
            yield from (file for file in files if file.is_file())


@cache
def import_names(text: str) -> list[str]:
    """Names that a Python text imports: modules, and what may be a module or a name in one."""
    names = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return names
