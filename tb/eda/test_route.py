"""Placed and routed parts: the tools' files, RC trees, timing by OpenSTA, the fit of wires."""

import numpy as np
import pytest

from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.cells.silicon import silicon
from splatcore.eda.cells.static_timing import Timing
from splatcore.eda.route.fit import by_fanout, fitted
from splatcore.eda.route.lef import read_lef
from splatcore.eda.route.place_route import Circuit, missing, placed_and_routed
from splatcore.eda.route.routed import Routed, segments
from splatcore.eda.route.timed import longest_path, spef
from splatcore.hdl.arithmetic.add import Add
from splatcore.spec.config import TINY
from tb.helpers.command import run
from tb.helpers.liberty import liberty_files

ROUTED_DEF = """\
UNITS DISTANCE MICRONS 200 ;
DIEAREA ( -200 0 ) ( 2000 1000 ) ;
COMPONENTS 2 ;
- inv_1 inv + PLACED ( 0 0 ) N ;
- inv_2 inv + PLACED ( 600 0 ) FS ;
END COMPONENTS
PINS 1 ;
- n4 + NET n4
  + LAYER M3 ( 0 0 ) ( 1 1 )
  + PLACED ( -96 200 ) N ;
END PINS
NETS 2 ;
- n4
  ( PIN n4 )
  ( inv_1 A )
  ( inv_2 A )
+ ROUTED M1 ( 0 200 ) via1_1
  NEW M2 ( 0 200 ) ( * 600 ) via2_1
  NEW M1 ( 0 600 ) ( 400 * ) ( 400 800 ) via1_1 ;
- n5
  ( inv_2 Y ) ;
END NETS
"""
ROUTED_RC = "n4 1 PIN/n4 2 ( 10 0.001 ( 20 0 inv_1/A , ( 5 0.002 inv_2/A ) ) )\n"

LEF = """\
MANUFACTURINGGRID 0.005 ;
LAYER M1
  TYPE ROUTING ;
  DIRECTION HORIZONTAL ;
  PITCH 0.4 ;
  WIDTH 0.2 ;
  RESISTANCE RPERSQ 0.1 ;
  CAPACITANCE CPERSQDIST 4e-5 ;
  EDGECAPACITANCE 3e-5 ;
END M1
LAYER M2
  TYPE ROUTING ;
  DIRECTION VERTICAL ;
  PITCH 0.5 ;
  WIDTH 0.2 ;
END M2
MACRO inv
  SIZE 1.5 BY 4 ;
  PIN A
    USE SIGNAL ;
  END A
END inv
MACRO fill
  SIZE 0.5 BY 4 ;
END fill
"""


@pytest.fixture
def folder(tmp_path):
    """A routed layout of two inverters."""
    (tmp_path / "a.lef").write_text(LEF)
    (tmp_path / "routed.def").write_text(ROUTED_DEF)
    (tmp_path / "routed.rc").write_text(ROUTED_RC)
    (tmp_path / "routed.rc.log").write_text("Final: No failed routes!\n")
    return tmp_path


def test_reading_a_layout(folder):
    lef, routed = read_lef(str(folder / "a.lef")), Routed.read(folder)
    assert (lef.units, lef.filler) == (200, "fill") and lef.sizes["inv"] == (1.5, 4.0)
    assert [layer.name for layer in lef.layers] == ["M1", "M2"]
    assert routed.area == (-1.0, 0.0, 10.0, 5.0) and routed.failed == 0
    assert routed.cells == {"inv_1": ("inv", 0.0, 0.0), "inv_2": ("inv", 3.0, 0.0)}
    assert routed.sinks == {"n4": 2, "n5": 0} and routed.wires["n5"] == []
    assert routed.lengths["n4"] == {"M1": 3.0, "M2": 2.0}
    # 3 µm of M1, 0.2 µm wide: its area and both of its edges
    assert routed.capacitances(lef)["n4"] == pytest.approx(3 * (0.2 * 4e-5 + 2 * 3e-5))
    driver, sinks, tree = routed.trees["n4"]
    assert (driver, sinks) == ("PIN/n4", 2)
    assert sorted(segments(tree)) == [
        (0, 1, 10.0, 0.001, None), (1, 2, 20.0, 0.0, "inv_1/A"), (2, 3, 5.0, 0.002, "inv_2/A")
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("routed.rc", "n4 1", "n6 1"), ("routed.rc", " ) ) )", " ) ) ) )"), ("a.lef", "MACRO", "X")],
)
def test_broken_files(folder, name, old, new):
    """Nets that do not match, unbalanced brackets, and files without cells are errors."""
    path = folder / name
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises((ValueError, IndexError), match=r"n6|are not in|unbalanced|has no cells"):
        read_lef(str(folder / "a.lef"))
        Routed.read(folder)


def test_failed_routes_are_counted(folder):
    (folder / "routed.rc.log").write_text("Final: 3 failed routes\nFinal: 2 failed routes\n")
    assert Routed.read(folder).failed == 2


def test_fit():
    """The fit finds the numbers that made the capacitances, whatever the sizes of the layouts."""
    random = np.random.default_rng(1)
    fanouts = [random.integers(1, 9, count) for count in (400, 50)]
    capacitances = [0.002 * (0.3 + 0.7 * fanout) for fanout in fanouts]
    assert fitted(fanouts, capacitances, 0.002) == pytest.approx((0.3, 0.7))
    noisy = [each + random.normal(0, 2e-4, len(each)) for each in capacitances]
    assert fitted(fanouts, noisy, 0.002) == pytest.approx((0.3, 0.7), abs=0.1)
    rows = by_fanout(fanouts[0], 10.0 * fanouts[0], capacitances[0])
    assert [row["fanout"] for row in rows] == ["1", "2", "3", "4", "5 to 7", "8 to 16"]
    assert sum(row["nets"] for row in rows) == 400
    assert rows[1]["um"] == pytest.approx(20) and rows[1]["ff"] == pytest.approx(3.4)


def lefs() -> str:
    """LEF files next to the libraries, technology first."""
    found = {path for file in liberty_files() for path in file.parent.glob("*.lef")}
    return ",".join(str(path) for path in sorted(found, key=lambda p: "tech" not in p.name))


needs_router = pytest.mark.skipif(
    bool(missing()) or not lefs(),
    reason=f"needs LEF files and apt-get install {' '.join(missing())}",
)


@needs_router
@pytest.mark.slow
def test_a_routed_adder():
    """A small part is routed; OpenSTA finds our time without wires, and with their capacitance."""
    library, lef = read_liberty(liberty_files()[0]), read_lef(lefs())
    part = silicon(Add(TINY.arithmetic, TINY.add_latency), library)
    circuit = Circuit(part.netlist)
    routed = Routed.read(placed_and_routed(circuit, lef))
    assert routed.failed == 0 and len(routed.cells) == len(part.netlist.kinds)
    for _, sinks, tree in routed.trees.values():
        assert sum(pin is not None for *_, pin in segments(tree)) == sinks

    plain = longest_path(circuit, part.assumed, library.text)
    assert plain == pytest.approx(part.timing.longest.time, abs=2e-5)

    class Wired(Timing):
        def _loads(self):
            load, fanout = super()._loads()
            for name, capacitance in routed.capacitances(lef).items():
                load[int(name[1:])] += capacitance
            return load, fanout

    lumped = Wired(part.netlist, part.assumed).longest.time
    trees = spef(routed, lef)
    wired = longest_path(circuit, part.assumed, library.text, trees)
    assert plain < lumped < wired < 1.1 * lumped  # resistance adds a little
    with pytest.raises(RuntimeError, match="not found"):  # wires of nets that do not exist
        longest_path(circuit, part.assumed, library.text, trees.replace("*D_NET n", "*D_NET x"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--route",), "go together"),
        (("--lef", "a.lef"), "go together"),
        (("--route", "--lef", "none.lef"), "No such file"),
    ],
)
def test_errors_of_the_command(words, message, liberty_path, capsys):
    assert (
        run("synth", "--stage", "add", "--preset", "tiny", "--liberty", liberty_path, *words) == 2
    )
    assert message in capsys.readouterr().err
