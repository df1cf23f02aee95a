"""The tool that plants faults: possible faults, verdicts of tests, missed faults."""

import argparse
from collections import Counter
from types import ModuleType

import numpy as np
import pytest
from _pytest.mark import KeywordMatcher
from _pytest.mark.expression import Expression
from amaranth.back import verilog

from splatcore.sim.rtl import vectors
from splatcore.spec.number import Float
from tb.helpers.parts import SideBySide
from tb.planted import mutate
from tb.planted.fault import KINDS, Fault, draw, faults
from tb.planted.judges import (
    ADDRESSES,
    BENCHES,
    DEFAULT,
    LAST,
    MACHINE,
    QUICK,
    WIDE,
    WITH_ALPHA,
    judges,
)
from tb.planted.mutate import HDL, judged, verdict

FORMATS = [Float(4, 3, subnormal=False), Float(3, 4, overflow="infinity")]
CODES = 1 << FORMATS[0].width

TEXT = """\
class Part:
    def __init__(self):
        self.size = 1 + 2

    def elaborate(self, platform):
        with m.If(self.i.valid & ~full):
            m.d.sync += [a.eq(b[3] ^ c[low : high + 1]), d["name"].eq(6)]
        with m.Elif(count == 3):
            m.d.comb += self.o.valid.eq(some)
        m.d.comb += [self.o.ready.eq(1), e.eq(-5 - f)]
"""

ALL = {
    ("condition", 6, "self.i.valid & ~full", "1"),
    ("operator", 6, "self.i.valid & ~full", "(self.i.valid | ~full)"),
    ("operator", 6, "~full", "(full)"),
    ("operator", 7, "b[3] ^ c[low:high + 1]", "(b[3] & c[low:high + 1])"),
    ("index", 7, "3", "4"),
    ("index", 7, "low", "(low) - 1"),
    ("index", 7, "high + 1", "(high + 1) - 1"),
    ("operator", 7, "high + 1", "(high - 1)"),
    ("constant", 7, "6", "7"),
    ("condition", 8, "count == 3", "1"),
    ("operator", 8, "count == 3", "(count != 3)"),
    ("handshake", 9, "some", "1"),
    ("operator", 10, "-5 - f", "(-5 + f)"),
}

TEST = """
from amaranth.sim import Simulator
from splatcore.hdl.arithmetic.minmax import Clamp
from splatcore.spec.number import Float


def test_clamp():
    part = Clamp(Float(2, 2))

    async def compare(context):
        context.set(part.enable, 1)
        for a in range(32):
            context.set(part.a, a)
            context.set(part.b, 6)
            await context.tick()
            assert context.get(part.o) == (a & 16) | min(a & 15, 6)

    simulator = Simulator(part)
    simulator.add_clock(1e-6)
    simulator.add_testbench(compare)
    simulator.run()
"""


def test_all_faults_of_a_text():
    """Constructors have no faults, nor has a `ready` that is constant."""
    found = {(fault.kind, fault.line, fault.before, fault.after): fault.text
             for fault in faults("part", TEXT)}  # fmt: skip
    assert set(found) == ALL
    lines = TEXT.splitlines()
    for (_, number, before, after), text in found.items():
        different = [k for k, line in enumerate(text.splitlines(), 1) if line != lines[k - 1]]
        assert different == [number], (before, after)


def test_a_draw_is_spread_and_repeats_itself():
    sources = {name: (HDL / f"{name}.py").read_text() for name in ("lib/stream", "sorting/merge")}
    drawn = draw(sources, 20, seed=3)
    assert drawn == draw(sources, 20, seed=3) != draw(sources, 20, seed=4)
    assert Counter(fault.file for fault in drawn) == dict.fromkeys(sources, 10)
    for name in sources:
        kinds = Counter(fault.kind for fault in drawn if fault.file == name)
        possible = Counter(fault.kind for fault in faults(name, sources[name]))
        assert {kind: min(n, 10 // len(KINDS)) for kind, n in possible.items()} == {
            kind: min(n, 10 // len(KINDS)) for kind, n in kinds.items()
        }
    everything = draw(sources, 10_000, seed=3)
    assert len({(fault.file, fault.text) for fault in everything}) == len(everything)


def of_clamp(before: str, after: str) -> Fault:
    """A fault in the first component of `arithmetic/minmax`."""
    text = (HDL / "arithmetic/minmax.py").read_text()
    assert before in text
    return Fault("arithmetic/minmax", "test", 0, before, after, text.replace(before, after, 1))


@pytest.mark.slow
def test_verdicts(tmp_path, monkeypatch, capsys):
    test = tmp_path / "test_clamp.py"
    test.write_text(TEST)
    weak = tmp_path / "test_nothing.py"
    weak.write_text("def test_nothing():\n    pass\n")
    monkeypatch.setenv("SPLATCORE_CACHE", str(tmp_path / "kept"))
    monkeypatch.setattr(mutate, "judges", lambda file: [str(weak), str(test)])
    given = [
        of_clamp("magnitude > self.b", "magnitude < self.b"),
        of_clamp("magnitude > self.b", "magnitude >= self.b"),
        of_clamp("self.a[-1]", "self.a[-7]"),
        of_clamp(", sign)", ", ~sign)"),
        of_clamp("m = Module()", "m = Modul()"),
    ]
    verdicts = ["caught", "missed", "not built", "caught", "not built"]
    results = mutate.Results(tmp_path / "planted.csv")
    assert judged(given, results) == verdicts
    printed = capsys.readouterr().out.splitlines()
    assert sorted(line[:9].strip() for line in printed if "→" in line) == sorted(verdicts)
    assert all(line.endswith(f"by {test}") for line in printed if line.startswith("caught"))
    monkeypatch.setattr(mutate, "verdict", lambda *_: "caught")
    kept = mutate.Results(tmp_path / "planted.csv")
    assert judged(given, kept) == verdicts
    assert judged(given, kept, again=True) == ["caught" if k == "missed" else k for k in verdicts]
    kept.keep(given[:2])
    assert [kept[fault] is not None for fault in given] == [True, True, False, False, False]


@pytest.mark.slow
def test_tests_that_hang_or_fail_anyway(tmp_path, monkeypatch):
    test = tmp_path / "test_clamp.py"
    test.write_text("import time\n\n\ndef test_hangs():\n    time.sleep(1000)\n")
    with monkeypatch.context() as patch:
        patch.setattr(mutate, "TIMEOUT", 5)
        assert verdict(str(test), tmp_path) == "caught"
    test.write_text(TEST.replace("min(", "max("))
    monkeypatch.setenv("SPLATCORE_CACHE", str(tmp_path / "kept"))
    monkeypatch.setattr(mutate, "judges", lambda file: [str(test)])
    with pytest.raises(RuntimeError, match="fails without a fault"):
        judged([of_clamp("magnitude > self.b", "1")], mutate.Results(tmp_path / "planted.csv"))
    with pytest.raises(RuntimeError, match="status 5"):
        verdict(f"{test} -k nothing", tmp_path)


ALL_JUDGES = sorted({tests for name in mutate.sources("hdl") for tests in judges(name[4:-3])})


def test_judges():
    """The most specific tests first, the machine last; each name is a file's or a folder's."""
    cull = judges("points/cull")
    assert cull[0] == QUICK["points/cull"] and "verilator-cull" in cull[1]
    assert cull[2:] == [LAST["points"], MACHINE, DEFAULT]
    assert judges("top")[-3:] == [MACHINE, DEFAULT, WIDE]
    assert judges("sorting/merge")[0] == QUICK["sorting"]
    for name in {*QUICK, *BENCHES, *LAST, *ADDRESSES, *WITH_ALPHA}:
        assert (HDL / name).is_dir() or (HDL / f"{name}.py").is_file(), name


@pytest.fixture(scope="module")
def items() -> list[pytest.Item]:
    """All tests of the judges' files, collected once."""
    found = []

    class Keep:
        def pytest_collection_finish(self, session):
            found.extend(session.items)

    words = {word.partition("::")[0] for tests in ALL_JUDGES for word in mutate.shlex.split(tests)}
    files = sorted(word for word in words if word.startswith("tb/"))
    chosen = mutate.shlex.split(mutate.CHOICE)
    assert pytest.main(["--collect-only", "-qq", *chosen, *files], plugins=[Keep()]) == 0
    return found


@pytest.mark.slow
@pytest.mark.parametrize("tests", ALL_JUDGES)
def test_judges_are_there(tests, items):
    parser = argparse.ArgumentParser()
    parser.add_argument("places", nargs="+")
    parser.add_argument("-k", default="")
    asked = parser.parse_args(mutate.shlex.split(tests))
    chosen = Expression.compile(asked.k) if asked.k else None
    for place in asked.places:
        own = [item for item in items if item.nodeid.startswith(place)]
        assert any(not chosen or chosen.evaluate(KeywordMatcher.from_item(item)) for item in own)


def multipliers() -> dict[int, list]:
    """Multipliers of each format by fault (0: none), for faults that can be built."""
    text, found = (HDL / "arithmetic/multiply.py").read_text(), {}
    for number, fault in enumerate([None, *faults("multiply", text)]):
        module = ModuleType("multiply")
        exec(fault.text if fault else text, module.__dict__)
        try:
            made = [module.Multiply(format, 2) for format in FORMATS]
            for part in made:
                verilog.convert(part)
        except Exception:
            continue
        found[number] = made
    return found


def missed(parts: dict[int, list], inputs: dict[str, np.ndarray]) -> set[int]:
    """Faults that change no product."""
    flat = {f"part{n}_{k}": part for n, all in parts.items() for k, part in enumerate(all)}
    given = {f"{name}__{port}": codes for name in flat for port, codes in inputs.items()}
    found = vectors.run(SideBySide(flat), given)
    products = {n: [found[f"part{n}_{k}__o"] for k in range(len(FORMATS))] for n in parts}
    return {n for n in parts if np.array_equal(products[n], products[0])}


@pytest.mark.verify
def test_faults_of_a_multiplier():
    """Faults that no pair of codes reveals have no effect in any order; weak tests miss more."""
    parts, pairs = multipliers(), []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        both = np.concatenate([rng.permutation(CODES**2), rng.integers(0, CODES**2, 5000)])
        enable = np.ones_like(both)
        enable[-4000:] = rng.integers(0, 2, 4000)
        pairs.append({"a": both % CODES, "b": both // CODES, "enable": enable})
    left = missed(parts, pairs[0])
    assert missed(parts, pairs[1]) == left
    weak = missed(parts, {name: np.minimum(codes, 1) for name, codes in pairs[0].items()})
    assert left < weak and len(parts) - len(weak) < 0.6 * (len(parts) - len(left))
    assert 0 in left and len(left) - 1 < 0.25 * (len(parts) - 1) and len(parts) > 20
