"""Waveforms: only the window and the module, of the estimated size, and matching viewer files."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from splatcore.app.cli.simulate import Request, planned
from splatcore.golden.pipeline import render
from splatcore.sim.machine import wave_files, waves
from splatcore.sim.machine.machine import Machine, Run
from splatcore.sim.machine.script import IDEAL
from splatcore.sim.machine.wave_files import (
    FST_HEADERS,
    Signal,
    _unpacked,
    check_kind,
    estimate,
    find_scope,
    signals,
    within,
)
from splatcore.sim.machine.waves import (
    Recording,
    Window,
    gtkwave,
    names_of,
    surfer,
    write_waves,
)
from splatcore.sim.rtl.convert import converted
from splatcore.sim.rtl.verilator import has_headers
from splatcore.spec.axi import BEAT
from splatcore.spec.config import TINY
from splatcore.spec.error import InputError
from tb.helpers.copier import BURST, SIZE, Copier, jobs

WINDOW = Window((250, 299))

NAMES = [
    Signal("TOP", "clk", 1, "a"), Signal("TOP.top", "clk", 1, "a"),
    Signal("TOP.top.raster.setup", "i__valid", 1, "b"),
    Signal("TOP.top.raster.setup", "i__ready", 1, "c"),
    Signal("TOP.top.raster.setup", "i__payload", 9, "d"),
    Signal("TOP.top.raster.setup", "i__payload.last", 1, "e"),
    Signal("TOP.top.raster.setup", "o__valid", 1, "f"),
    Signal("TOP.top.points.setup", "state", 3, "g"),
    Signal("TOP.top.raster.setups", "state", 3, "h"),
]  # fmt: skip


def without_codes(names: list[Signal]) -> list[tuple[str, str, int]]:
    """Signals without their codes, which differ from file to file."""
    return [(signal.scope, signal.name, signal.width) for signal in names]


def test_find_scope():
    assert find_scope(NAMES, "raster.setup") == "TOP.top.raster.setup"
    assert find_scope(NAMES, "top") == "TOP.top"
    for wanted, message in (
        ("setup", "could be TOP.top.raster.setup, TOP.top.points.setup; give more"),
        ("top.setap", "no such module; similar: setup"),
        ("aster.setup", "no such module"),
    ):
        with pytest.raises(InputError, match=f"--scope {wanted}: .*{message}"):
            find_scope(NAMES, wanted)
    assert within(NAMES, "TOP.top.raster.setup", 99) == NAMES[2:7]
    assert within(NAMES, "TOP", 2) == NAMES[:2]
    assert within(NAMES, "TOP.top", 3) == NAMES[1:] and within(NAMES, "TOP.top", 2) == NAMES[1:2]
    assert within(NAMES, "TOP.top", 99) == NAMES[1:]


def test_views(tmp_path):
    """GTKWave shows the fields of payloads, Surfer whole payloads; neither shows other signals."""
    lines = gtkwave(tmp_path / "w.vcd", (7, 9), NAMES).splitlines()
    setup = "TOP.top.raster.setup.i__"
    group = ["@800200", "-i", "@28", f"{setup}valid", "@28", f"{setup}ready", "@22",
             f"{setup}payload[8:0]", "@28", f"{setup}payload.last", "@1000200", "-i"]  # fmt: skip
    assert lines[-14:] == ["@200", "-TOP.top.raster.setup", *group]
    assert lines[:2] == [f'[dumpfile] "{tmp_path}/w.vcd"', "[timestart] 70"]
    assert "TOP.clk" in lines and not any("o__valid" in line for line in lines)
    assert surfer(tmp_path / "w.vcd", (7, 9), NAMES).splitlines() == [
        f"load_file {tmp_path}/w.vcd", "variable_add TOP.clk", "divider_add TOP.top.raster.setup",
        *(f"variable_add {setup}{name}" for name in ("valid", "ready", "payload")), "zoom_fit",
    ]  # fmt: skip


def test_window_counts():
    assert Window((10, 19)).count(1000, 500) == 10
    assert Window((10, 10**9)).count(1000, 500) == 991
    assert Window((2000, 2001)).count(1000, 500) == 1
    one, more = (Window(share=share).count(10**6, 10**5) for share in (0.01, 0.5))
    assert 1000 < one < 3000 and 50_000 < more < 150_000


def test_fst_names(tmp_path):
    """A file built from the format's description: modules, names, widths, two names of a net."""
    text = b"\xfe\x00TOP\x00\x00" + b"\x10\x00clk\x00\x01\x00" + b"\xfe\x00top\x00\x00"
    text += b"\x10\x00clk\x00\x01\x01" + b"\x10\x00wide [299:0]\x00\xac\x02\x00" + b"\xff\xff"
    data = bytes([len(text) - 15 << 4 & 0xF0 | 0xF0, len(text) - 15]) + text
    block = bytes([6]) + (16 + len(data)).to_bytes(8) + len(text).to_bytes(8) + data
    path = tmp_path / "w.fst"
    path.write_bytes(bytes([0]) + (329).to_bytes(8) + bytes(321) + block)
    assert list(signals(path)) == [
        Signal("TOP", "clk", 1, "1"), Signal("TOP.top", "clk", 1, "1"),
        Signal("TOP.top", "wide", 300, "2"),
    ]  # fmt: skip
    path.write_bytes(bytes([0]) + (329).to_bytes(8) + bytes(321))
    with pytest.raises(InputError, match="has no names"):
        list(signals(path))


def test_lz4():
    """Literals; a match that overlaps itself, with a continued length; literals at the end."""
    long = bytes([0x2F]) + b"ab" + (2).to_bytes(2, "little") + bytes([255, 1])
    assert _unpacked(long + b"\x30xyz") == b"ab" + (b"ab" * 138)[: 4 + 15 + 256] + b"xyz"


def test_kinds(monkeypatch):
    assert check_kind(Path("w.vcd")) == check_kind(Path("w")) == "vcd"
    with pytest.raises(InputError, match=r"w\.ghw: must end in \.vcd or \.fst"):
        check_kind(Path("w.ghw"))
    monkeypatch.setattr(wave_files, "has_headers", lambda *names: "lz4.h" not in names)
    with pytest.raises(InputError, match=r"w\.fst: FST needs zlib\.h and lz4\.h .*liblz4-dev"):
        check_kind(Path("w.fst"))
    assert has_headers("cstdio") and not has_headers("cstdio", "no_such_header.h")


def test_too_large(monkeypatch, tmp_path, capsys):
    """Waveforms estimated above --waves-max are refused, in one line, before simulation."""
    names = [Signal("TOP.top.queue", f"n{k}", 32, str(k)) for k in range(100)]
    monkeypatch.setattr(waves, "names_of", lambda machine: names)
    frame, machine = render(TINY, *jobs()[0]), SimpleNamespace(config=TINY)
    asked = Request(tmp_path / "out.png", waves=tmp_path / "w.vcd", scope="queue", waves_max=0.5)
    few, many = (Window((0, last)) for last in (99, 999))
    plan = planned(machine, few, asked, frame)
    assert plan == Recording(asked.waves, few, "TOP.top.queue", 99)
    assert "w.vcd: about 0.09 MB, 100 signals in 100 cycles" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"w\.vcd: about 0\.80 MB, .* above --waves-max 0\.5; u"):
        planned(machine, many, asked, frame)
    plan = planned(machine, few, replace(asked, scope=None), frame)
    assert (plan.scope, plan.levels) == ("TOP", 4)


@pytest.fixture(scope="module", params=["vcd", "fst"])
def traced(request) -> Machine:
    if request.param == "fst" and not has_headers(*FST_HEADERS):
        pytest.skip(f"FST needs {' and '.join(FST_HEADERS)}")
    return Machine(TINY, converted(Copier()), request.param)


@pytest.fixture
def recording(traced, tmp_path) -> Recording:
    kind = "fst" if "FST 1" in (traced.program.parents[1] / "config.hpp").read_text() else "vcd"
    return Recording(tmp_path / f"w.{kind}", WINDOW)


def recorded(traced: Machine, recording: Recording) -> Run:
    return write_waves(traced, jobs(), IDEAL, recording, "simulating")


@pytest.mark.slow
def test_window_alone(traced, recording):
    run = recorded(traced, recording)
    assert run.done and run.report.window == WINDOW.cycles
    if recording.path.suffix == ".vcd":
        lines = recording.path.read_text().splitlines()
        times = [int(line[1:]) for line in lines if line.startswith("#")]
        assert times == list(range(2500, 3000, 5))
    with pytest.raises(InputError, match="before the window began"):
        recorded(traced, replace(recording, window=Window((10**6, 10**6))))


@pytest.mark.slow
@pytest.mark.parametrize("module, most", [("top", 80_000), ("queue", 30_000)])
def test_scope(traced, recording, module, most):
    """Only the module's signals, about the estimated bytes, and matching viewer files."""
    names = names_of(traced)
    scope = find_scope(names, module)
    recording = replace(recording, scope=scope, levels=99)
    run = recorded(traced, recording)
    found = list(signals(recording.path))
    wanted = within(names, scope, 99)
    assert without_codes(found) == without_codes(wanted) and len(found) < len(names)
    size, kind = recording.path.stat().st_size, recording.path.suffix[1:]
    assert size < most
    assert size / 3 < estimate(wanted, WINDOW.count(run.report.cycles, 0), kind) < 3 * size
    recorded_names = {f"{signal.scope}.{signal.name}" for signal in found}
    lines = recording.path.with_suffix(".gtkw").read_text().splitlines()
    shown = {re.sub(r"\[.*", "", line) for line in lines if line.startswith("TOP")}
    assert "TOP.top.queue.i__payload" in shown and shown <= recorded_names
    lines = recording.path.with_suffix(".sucl").read_text().splitlines()
    added = {line.partition(" ")[2] for line in lines if line.startswith("variable_add ")}
    assert lines[0] == f"load_file {recording.path}" and lines[-1] == "zoom_fit"
    assert f"divider_add {scope}" in lines
    assert added == {
        name for name in shown if name.count(".") == name.rpartition("__")[0].count(".")
    }


@pytest.mark.slow
def test_tile(traced, tmp_path):
    """From the read of its list to its last pixel; here the first 4 rows."""

    def watch(areas):
        read = areas.models[0] + 2 * BURST * BEAT
        return {"watch": f"{read} {areas.images[0]} {SIZE[0] * 3} 0 {SIZE[0] * 3} 0 4"}

    run = traced.run(jobs(), IDEAL, settings=watch, keep=tmp_path)
    first, last = run.report.window
    ready = run.frames[0].ready
    assert ready < first < ready + 20
    assert first + 4 * SIZE[0] * 3 // BEAT < last < run.frames[0].finished - 50
