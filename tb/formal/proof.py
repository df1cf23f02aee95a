"""A table entry of a proof: components to prove, cases to reach, planted faults that break it."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from importlib import import_module
from pkgutil import iter_modules

from amaranth.lib import wiring

from splatcore.sim.rtl.formal import cover, prove, search
from tb import formal
from tb.helpers.parts import SideBySide

Make = Callable[[], wiring.Component]


@dataclass(frozen=True)
class Part:
    """A component whose assertions hold.

    search: cycles from the beginning to search; default: a proof by induction
    cover: cycles within which every cover statement is reached; default: not checked
    verify: whether only `make verify` proves it
    setting: in force while the component is made and converted
    """

    make: Make
    search: int | None = None
    cover: int | None = None
    verify: bool = False
    setting: Callable[[], AbstractContextManager] = nullcontext

    def holds(self) -> None:
        """ProofError if an assertion does not hold."""
        with self.setting():
            if self.search is None:
                prove(self.make())
            else:
                search(self.make(), self.search)

    def reached(self) -> None:
        """ProofError if a case is not reached, so that assertions would hold for lack of cases."""
        with self.setting():
            cover(self.make(), self.cover)


@dataclass(frozen=True)
class Proof:
    """Parts by name, and faults that the proof of a part finds.

    faults: by name: class, method, text to replace in the method, new text
    faulty: the part into which faults are planted, by fault or, as "", for all others; it fails
        within its `search`
    """

    parts: Mapping[str, Part]
    faults: Mapping[str, tuple[type, str, str, str]]
    faulty: Mapping[str, Part] = field(default_factory=dict)

    def judge(self, fault: str) -> Part:
        return self.faulty.get(fault) or self.faulty.get("") or next(iter(self.parts.values()))


def side_by_side(
    parts: Mapping[str, Make], faults: Mapping[str, Mapping[str, tuple]], cover: int
) -> Proof:
    """The proof of parts in one solver run. faults: by part that they are planted into."""
    whole = Part(lambda: SideBySide({name: make() for name, make in parts.items()}), cover=cover)
    found = {fault: about for table in faults.values() for fault, about in table.items()}
    judges = {fault: Part(parts[name]) for name, table in faults.items() for fault in table}
    return Proof({"all": whole}, found, judges)


def proofs() -> dict[str, Proof]:
    """Every `PROOF` in `tb/formal`, by file."""
    names = [found.name for found in iter_modules(formal.__path__)]
    modules = {name: import_module(f"tb.formal.{name}") for name in names}
    return {name: module.PROOF for name, module in modules.items() if hasattr(module, "PROOF")}
