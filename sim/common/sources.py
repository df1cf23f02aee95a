"""The code behind a result: a function's module and everything that it imports of Splatcore."""

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
    """Return a key of all code that a function or module depends on, for the keys of results."""
    return files_key(Path(inspect.getsourcefile(source)))


def files_key(path: Path, root: Path = ROOT) -> str:
    """Return a hash of the files of a `closure`.

    Comments count, too: better measure a result again than keep a wrong one.
    """
    text = hashlib.sha256()
    for file in sorted(closure(path, root)):
        text.update(f"{file.name}\0".encode() + file.read_bytes())
    return text.hexdigest()


def closure(path: Path, root: Path = ROOT) -> set[Path]:
    """Return a Python file and all files of the package that it imports, directly or indirectly.

    Includes the `__init__.py` of each package, and the non-Python files next to each module, which
    it may read.
    root: the folder of the package's rooms
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
    """Yield the files of the package's modules that a Python file imports, at any depth."""
    for name in import_names(path.read_text()):
        if name.startswith(f"{PACKAGE}."):
            module = root.joinpath(*name.split(".")[1:])
            files = module.with_suffix(".py"), module / "__init__.py"
            yield from (file for file in files if file.is_file())


@cache
def import_names(text: str) -> list[str]:
    """Return the names that a Python text imports: modules, and names in modules."""
    names = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return names
