"""The power ESTIMATE: SAIF files, its arithmetic, and activity against a frame's counters."""

import json
from dataclasses import replace
from math import isclose
from pathlib import Path
from types import SimpleNamespace

import pytest

from splatcore.eda.gates.machine_gates import part_around
from splatcore.eda.power import activity, cells, clocks
from splatcore.eda.power.activity import Accesses, Activity, Register, counts_of, read_counts
from splatcore.eda.power.estimate import CLOCK_HZ, estimate, gates_of
from splatcore.eda.power.saif import Net, duration, nets
from splatcore.eda.power.tables import lines, report, table
from splatcore.sim.machine.execute import execute
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import IDEAL, Script
from splatcore.spec.cache import VARIABLE
from splatcore.spec.config import TINY
from splatcore.spec.energy import Energy
from splatcore.spec.error import InputError
from splatcore.spec.stages import OF_POINTS
from tb.helpers.command import check_documented, run
from tb.helpers.machines import garden, view
from tb.helpers.power import CLOCKS, COUNTS, GATES, SIZES, UNIT

HERE = Path(__file__).parent

IDLE, STILL, SEQUENCED = 25_000, 0.0004, 0.16
"""Idle cycles, and the highest activity per bit and cycle of a part in them, without and with a
sequencer. Registers start with random bits, which drain from pipelines and which the arrays'
sequencers keep selecting."""

ALSO_SEQUENCED = ("colour", "points, the rest")
"""Other parts with a sequencer like the arrays', or with an array's results as inputs."""

BUCKET_CAUSES = ("write_buckets", "read_lists", "read_long_lists")
"""Causes of traffic that differ between frames of one view: a frame's first list is put into
buckets of the previous frame."""

UNRESET = 16  # rows that random registers may write before reset
LATE = 32  # cycles in which a driver sees and clears an interrupt

STORAGE = "render.features.storage"

NO_REGIONS = SimpleNamespace(base=0, regions=())  # memory without accessible regions


@pytest.fixture
def saif(tmp_path):
    path = tmp_path / "a.saif"
    path.write_text((HERE / "small.saif").read_text())
    return path


def test_nets_of_a_file(saif):
    assert duration(saif) == 100
    found = list(nets(saif))
    assert found[0] == Net(("TOP",), "clk", 100, 0, 0)
    assert [net.name for net in found[1:5]] == ["wide[0]", "wide[1]", "$5", "valid"]
    assert found[3] == Net(("TOP", "top", "axi$3", "ar"), "$5", 50, 50, 7)
    assert found[4].path == ("TOP", "top", "axi$3")
    assert found[6].path == ("TOP", "top", *STORAGE.split("."), "macro")
    assert len(found) == 9


@pytest.mark.parametrize("cut, why", [("(DURATION 100)", "DURATION"), (" )\n)\n", "ends within")])
def test_broken_file(saif, cut, why):
    whole = saif.read_text()
    saif.write_text(whole.replace(cut, "", 1) if "DUR" in cut else whole.removesuffix(cut))
    with pytest.raises(InputError, match=why):
        duration(saif)
        list(nets(saif))


def test_counts_of_a_file(saif):
    parts, registers, memories = read_counts(saif, {STORAGE: (32, 8)}, 0.5)
    assert parts == {"axi": Activity(2, 5.5, 0), "top, the rest": Activity(2, 4.0, 1)}
    assert registers == {"axi.valid": Register("axi", 1, [0.2], 2.0)}
    assert memories == [Accesses(STORAGE, "features", 32, 8, 1.5, 12.5)]
    with pytest.raises(ValueError, match="other memories"):
        read_counts(saif, {}, 1.0)


def test_parts():
    assert part_around("") == part_around("nobody") == "top, the rest"
    assert part_around("render.raster.rasterizer3.blend.sums") == "blend"
    assert part_around("render.raster.lanes1_quad3.blend.sums") == "quad"
    assert part_around("preprocess.points.project.array") == "project"


def test_energies():
    assert UNIT.switching == 10 and UNIT.clock == 3 and UNIT.dram_byte == 2
    assert UNIT.access(64, 8) == 500 and UNIT.access(256, 16) == 2000
    for value in (-1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match=f"energy: fan_out {value} is not 0 or more"):
            Energy(fan_out=value)
    with pytest.raises(InputError, match="energy: memory_words is 0"):
        Energy(memory_words=0)


def test_estimate():
    """A frame of 1000 cycles in fJ: 10 per gate and change of a bit, 3 per flip-flop that is
    clocked, or clock gate, and cycle."""
    found = estimate(COUNTS, GATES, CLOCKS, UNIT)
    axi, cull = found.logic["axi"], found.logic["cull"]
    assert isclose(axi.activity, 0.004) and isclose(cull.activity, 0.005)
    assert isclose(axi.switching, 4 * 1000 * 10e-15) and isclose(axi.clock, 1000 * (35 + 2) * 3e-15)
    assert isclose(axi.clock_always, 1000 * 70 * 3e-15)
    assert isclose(cull.switching, 5 * 500 * 10e-15) and isclose(cull.clock, 1000 * 20 * 3e-15)
    memory = found.memories["a.b", "stage 0"]
    assert memory.kilobits == 4 and isclose(memory.access, 50 * 2000e-15)
    frame = (40_000 + 111_000 + 25_000 + 60_000 + 100_000) * 1e-15
    assert isclose(found.frame, frame)
    leakage = (1500 * 4.0 + 4096 * 0.5) * 1e-9
    assert isclose(found.leakage, leakage)
    assert found.dram == {"read_model": 128e-12, "write_pixels": 72e-12}
    assert found.fps_max == CLOCK_HZ / 1000
    assert isclose(found.power(50), 50 * frame + leakage)
    assert isclose(found.pixels_per_joule(50, True), 48 / (frame + leakage / 50 + 200e-12))
    stages = found.stages
    assert list(stages) == ["stage 0", "control"] and stages["control"] == axi
    for name, part in gates_of(SIZES, UNIT).items():
        assert part == pytest.approx(GATES[name])
    with pytest.raises(ValueError, match="only sizes or counts"):
        estimate(COUNTS, {"axi": GATES["axi"]}, CLOCKS, UNIT)


def test_report():
    found = estimate(COUNTS, GATES, CLOCKS, UNIT)
    facts = json.loads(json.dumps(report(found, COUNTS, UNIT, 100.0)))
    assert facts["constants"]["supply"] == 2.0 and facts["parts"]["axi"]["still"] == 20
    assert isclose(facts["power_w"], found.power(100.0))
    assert isclose(facts["frame_j"] * 100, facts["power_w"])
    assert facts["traffic_bytes"] == COUNTS.traffic
    assert isclose(facts["paper"]["logic_fj"]["stage 0"], 2.14e-3 / 12_900 / 8e8 / 1e-15)
    assert "ESTIMATE" in lines(found, 100.0)[0]
    assert [row[0] for row in table(found, 100.0, "").rows] == [
        "stage 0", "control", "memories, stage 0", "all logic", "all", "DRAM, not included"
    ]  # fmt: skip


def test_counts_stay(monkeypatch, tmp_path):
    """Counts are kept: other energy constants reuse them, another view or sample simulates."""
    job, made = Job(garden(TINY, 100), view(16, 16)), []
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    monkeypatch.setattr(activity, "machine_source", lambda config: "module top;")
    monkeypatch.setattr(activity, "simulated_counts", lambda *asked: made.append(asked) or COUNTS)
    for config in (TINY, replace(TINY, energy=UNIT)):
        assert counts_of(config, job, 1, "") == COUNTS and len(made) == 1
    for other in ((job._replace(camera=view(16, 16, 0.1)), 1), (job, 2)):
        assert counts_of(TINY, *other, "") == COUNTS
    assert len(made) == 3


def test_command(monkeypatch, tmp_path, capsys):
    """The whole command, with given counts and sizes instead of simulation and synthesis."""
    monkeypatch.setattr(activity, "counts_of", lambda *args: COUNTS)
    monkeypatch.setattr(cells, "netlist", lambda config: None)
    monkeypatch.setattr(clocks, "clocked", lambda *args: CLOCKS)
    monkeypatch.setattr(cells, "sizes", lambda *args: SIZES)
    out, asked = tmp_path / "p.json", ("power", "needles", "--size", "16x16", "--preset", "tiny")
    assert run(*asked, "--fps", "50", "--json", str(out)) == 0
    assert "ESTIMATE, first order: needles 16x16, preset TINY, 50.0" in capsys.readouterr().out
    facts = json.loads(out.read_text())
    expected = estimate(COUNTS, gates_of(SIZES, TINY.energy), CLOCKS, TINY.energy)
    assert facts["power_w"] == expected.power(50.0) and facts["size"] == [16, 16]
    assert run(*asked) == 0
    assert "800000.0 frames per second" in capsys.readouterr().out
    assert run(*asked, "--toggles", "--json", str(out)) == 0
    assert [row["name"] for row in json.loads(out.read_text())["costs"]] == [
        "a.b", "axi.full", "axi.kept"
    ]  # fmt: skip
    for options, why in (
        (("--fps", "800001"), "--fps 800001: is above 800000.0"),
        (("--fps", "0"), "--fps 0: must be above 0"),
        (("--liberty", "a.lib"), "--liberty a.lib: goes with --process only"),
        (("--process", "130"), "--process 130.0: goes with --liberty only"),
        (("--liberty", "a.lib", "--process", "130"), "a.lib: No such file"),
        (("--sample", "-1"), "--sample -1: must be above 0"),
        (("--size", "128x16"), "picture of 128x16: preset TINY renders up to 64x64"),
    ):
        assert run(*asked, *options) == 2
        assert why in capsys.readouterr().err


def test_command_in_cells(monkeypatch, liberty_path, tmp_path, capsys):
    """With `--liberty` the estimate uses the library's energies."""
    silicon = SimpleNamespace(wired=None)
    monkeypatch.setattr(activity, "counts_of", lambda *args: COUNTS)
    monkeypatch.setattr(cells, "netlist", lambda config: None)
    monkeypatch.setattr(clocks, "clocked", lambda *args: CLOCKS)
    monkeypatch.setattr(cells, "machine_silicon", lambda *args: (None, silicon))
    monkeypatch.setattr(cells, "gates_in_cells", lambda *args: GATES)
    out, asked = tmp_path / "p.json", ("power", "needles", "--size", "16x16", "--preset", "tiny")
    library = "--liberty", str(liberty_path), "--process", "130"
    assert run(*asked, "--fps", "50", "--json", str(out), *library) == 0
    assert "In cells of small, scaled from 130 nm, 0.9 V" in capsys.readouterr().out
    facts = json.loads(out.read_text())
    assert facts["power_w"] == estimate(COUNTS, GATES, CLOCKS, TINY.energy).power(50.0)
    assert facts["liberty"]["scale"] == TINY.energy.scale(130, 0.9)
    check_documented("`splatcore power`", list(facts["liberty"]))


SMALL = replace(TINY, name="SMALL", sub_sorter="trees", rasterizers=1)


@pytest.mark.verify
def test_frame(monkeypatch):
    """Memory accesses and traffic of a frame match the frame's own counters in RTL."""
    monkeypatch.setattr(activity, "kept_json", lambda kind, made_from, compute: compute())
    job = Job(garden(SMALL, 300), view(48, 32))
    runs = []

    def noted(*args, **options):
        runs.append(simulate(*args, **options))
        return runs[-1]

    simulate = activity.simulate
    monkeypatch.setattr(activity, "simulate", noted)
    counts = counts_of(SMALL, job, 1, "frame")
    (found,) = runs
    counters = found.frames[-1].counters
    assert counts.simulated == found.report.cycles
    assert counts.cycles == found.frame_cycles[0] == pytest.approx(counts.counted, abs=LATE)
    writes, reads = ({}, {})
    for memory in counts.memories:
        name = memory.path.removeprefix("render.sort.runs.")
        writes[name], reads[name] = round(memory.writes, 2), round(memory.reads, 2)
    sorters = [f"sorter{k}.part.memory" for k in range(SMALL.sub_sorters)]
    assert sum(writes[name] for name in sorters) == pytest.approx(counters["sort_entries"], abs=0.1)
    assert sum(reads[name] for name in sorters) == pytest.approx(counters["sort_entries"], abs=0.1)
    for cause, size in counts.traffic.items():
        if cause in BUCKET_CAUSES:
            assert 0 < size < found.report.traffic[cause], cause
        else:
            assert 2 * size == found.report.traffic[cause], cause
    assert all(part.bits > part.still > 0 for part in counts.parts.values())
    assert counts.parts["project"].changes > 0
    monkeypatch.setattr(activity, "SAMPLE_LENGTH", 512)
    sampled = counts_of(SMALL, job, 3, "frame")
    assert sampled.counted < counts.counted / 2 and sampled.cycles == counts.cycles


@pytest.mark.verify
def test_nothing_started(tmp_path):
    """A machine that is not started hardly switches: nets settle once, and only the arrays'
    sequencers keep running."""
    machine = activity.Machine(SMALL, activity.machine_source(SMALL), toggles=True)
    script = Script(SMALL)
    script.cycles(IDLE)
    (tmp_path / "memory").write_bytes(bytes(1 << 12))
    execute(machine.program, tmp_path, script, NO_REGIONS, IDEAL, settings=activity.settings(1))
    sizes = activity.memory_sizes(activity.machine_source(SMALL))
    parts, _, memories = read_counts(tmp_path / "waves.saif", sizes, 1.0)
    for name, found in parts.items():
        most = SEQUENCED if name in (*OF_POINTS, *ALSO_SEQUENCED) else STILL
        assert found.changes / found.bits / IDLE < most, name
    assert sum(memory.writes for memory in memories) < UNRESET
