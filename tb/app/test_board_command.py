"""The commands `board`: a simulated board renders frames; files for a real board; refusals."""

import json
import os
import re
import shutil
import tomllib
import tty
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from litedram import init, modules
from litedram.phy.model import get_sdram_phy_settings
from PIL import Image

from splatcore.app.cli import board as board_command
from splatcore.eda.board import host
from splatcore.eda.board.host import place_in
from splatcore.eda.gates.synth import yosys
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.frame import engines
from splatcore.spec.config import TINY
from splatcore.spec.error import InputError
from splatcore.spec.registers import (
    ABORT,
    READY,
    RENDERING,
    address_values,
    addresses,
    control_registers,
)
from splatcore.spec.work import aligned, scratch_bytes, stride, work
from tb.helpers.board_simulation import simulated_board
from tb.helpers.command import ROOT, check_documented, check_refused, run
from tb.helpers.configs import ALPHA
from tb.helpers.front_ends import ULX3S_CELLS, slang

SIZE, FEW = (40, 24), "40x24"


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    """A few small Gaussians, which the simulated UART transfers within half a minute."""
    garden, path = generate("garden", 150), tmp_path_factory.mktemp("scene") / "small.ply"
    write_ply(path, replace(garden, scale=garden.scale * 0.4))
    return path


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """Folder and port of a simulated board; its log is checked for violations at the end."""
    folder = tmp_path_factory.mktemp("board")
    with simulated_board(ALPHA, folder) as port:
        yield folder, port
    log = (folder / "log").read_text()
    assert "PASS=1" in log and "violation" not in log


@pytest.fixture(autouse=True)
def long_timeouts(monkeypatch):
    """Raise the timeouts: a simulated board is slower than a real one."""
    monkeypatch.setattr(host, "ANSWER_SECONDS", 600.0)
    monkeypatch.setattr(host, "FRAME_SECONDS", 600.0)


def changed(board: tuple[Path, str], folder: Path, **facts) -> str:
    """Write a board's files with changed facts; return their folder as an argument."""
    shutil.copy(board[0] / host.PRESET, folder)
    known = json.loads((board[0] / host.FACTS).read_text())
    (folder / host.FACTS).write_text(json.dumps(known | facts))
    return str(folder)


def test_areas_do_not_overlap():
    """Model, scratch, image and work area fill the memory one after the other, without overlap."""
    model, _ = pack(generate("garden", 150), TINY)
    camera, at, size = generated_camera("garden", *SIZE), 1 << 30, 1 << 22
    areas = place_in(TINY, model, camera, at, size)
    (registers,), offsets = areas.registers, work(TINY, areas.pages, areas.features)
    begins = [areas.models[0], registers["SCRATCH"], areas.images[0], registers["GROUPS"]]
    begins += [registers["LISTS"], registers["FEATURES"], areas.end]
    sizes = [len(model.image), scratch_bytes(TINY), stride(SIZE[0]) * SIZE[1]]
    sizes += [offsets.lists, offsets.features - offsets.lists, offsets.size - offsets.features]
    assert begins[0] == at and at + size - 4096 < areas.end <= at + size
    assert [after - before for before, after in pairwise(begins)] == [
        aligned(each) for each in sizes
    ]
    assert registers | address_values(TINY, "LISTS", begins[4]) == registers
    with pytest.raises(InputError, match=r"150 Gaussians at 40x24 take .* the board has 0\.03125"):
        place_in(TINY, model, camera, at, 1 << 15)


@pytest.mark.slow
def test_files(tmp_path, capsys):
    """Verilog that yosys accepts, a pin for every port, a Makefile, the SDRAM's start sequence."""
    folder = tmp_path / "ulx3s"
    words = "--preset tiny --clock 40 --baud 500000 --sdram 64"
    assert run(f"board write {words} -o {folder}") == 0
    printed = capsys.readouterr().out.split()
    assert sorted(printed) == sorted(str(path) for path in folder.rglob("*") if path.is_file())
    facts = json.loads((folder / host.FACTS).read_text())
    assert facts["clock_hz"] == 40_000_000 and facts["baud"] == 500_000
    assert facts["memory"] == {"at": 1 << 30, "bytes": 64 << 20}
    check_start(facts["start"])
    config, _ = host.read_board(str(folder))
    assert config == TINY
    names = ["rtl/splatcore_memories.v", "rtl/splatcore_top.v", "splatcore_board.v"]
    texts = {os.path.basename(name): (folder / name).read_text() for name in names}
    script = "read_verilog -lib +/ecp5/cells_sim.v +/ecp5/cells_bb.v\nread_verilog {}\n"
    script += "hierarchy -check -top splatcore_board\n"
    board = texts["splatcore_board.v"]
    assert not re.search(r"LiteX sha1|20\d\d-\d\d-\d\d", board)
    yosys(script.format(" ".join(texts)), texts)
    assert not slang("splatcore_board", ULX3S_CELLS, *(folder / name for name in names))
    ports = re.findall(
        r"^ +(?:in|out|inout)(?:put)? +(?:wire|reg) +(\[\d+:0\])? *(\w+)", board, re.M
    )
    pins = (folder / "splatcore_board.lpf").read_text()
    assert {name for _, name in ports} >= {"clk25", "serial_tx", "sdram_dq"}
    assert not [name for _, name in ports if f'COMP "{name}' not in pins]
    makefile = (folder / "Makefile").read_text()
    assert all(name in makefile for name in (*names, "--85k", "--seed $(SEED)"))
    script = (folder / "synthesis.ys").read_text()
    assert script.startswith(f"read_verilog {' '.join(names)}\nsynth_ecp5 -top splatcore_board ")


def check_start(writes: list):
    """Compare with LiteDRAM's Python header; the last write hands the SDRAM to the controller."""
    module = modules.AS4C32M16(40e6, "1:1")
    settings = get_sdram_phy_settings("SDR", 16, 40e6), module.timing_settings
    known: dict = {}
    exec(init.get_sdram_phy_py_header(*settings), known)
    (_, address, bank, control, cycles), *commands = known["init_sequence"]
    values = [value for _, value, _ in writes]
    assert values[:3] == [address, bank, control]
    assert writes[2][2] == pytest.approx(cycles / 40e6)
    for k, (_, address, bank, command, cycles) in enumerate(commands):
        assert values[4 * k + 3 : 4 * k + 7] == [address, bank, command, 1]
        assert writes[4 * k + 6][2] == pytest.approx(cycles / 40e6)
    assert values[4 * len(commands) + 3 :] == [known["dfii_control_sel"]]
    places = [each for each, _, _ in writes]
    assert len(set(places)) == 5 and places[2] == places[-1]


def test_refused(tmp_path, capsys, scene):
    render = f"board render {scene} -o {tmp_path / 'a.png'} --port /dev/nothing --board"
    check_refused(capsys, f"{render} {tmp_path}", "board.json: No such file")
    (tmp_path / host.FACTS).write_text("{")
    check_refused(capsys, f"{render} {tmp_path}", "board.json: is not JSON")
    (tmp_path / host.FACTS).write_text("[]")
    check_refused(capsys, f"{render} {tmp_path}", "board.json: not a board's file")
    facts = {"preset": "TINY", "registers": 0, "baud": 9600, "memory": {}, "start": []}
    (tmp_path / host.FACTS).write_text(json.dumps(facts | {"clock_hz": 1}))
    check_refused(capsys, f"{render} {tmp_path} --size 128x10", "preset TINY renders up to 64x64")
    check_refused(capsys, f"{render} {tmp_path} --size {FEW}", "^error: /dev/nothing: ")
    wide = tmp_path / "wide.toml"
    wide.write_text('base = "TINY"\naddress_bits = 64\n')
    write = f"board write -o {tmp_path / 'b'}"
    check_refused(capsys, f"{write} --preset {wide}", "address_bits 64: a board's bus has 32 bits")
    check_refused(capsys, f"{write} --sdram 16", "--sdram '16': unknown")
    assert not (tmp_path / "b").exists()


def test_no_answer(tmp_path, capsys, scene, monkeypatch):
    """A serial port without a board: the command times out with one line."""
    monkeypatch.setattr(host, "ANSWER_SECONDS", 0.2)
    facts = {"preset": "TINY", "registers": 0, "baud": 9600, "memory": {}, "start": []}
    (tmp_path / host.FACTS).write_text(json.dumps(facts | {"clock_hz": 1}))
    _, port = os.openpty()
    tty.setraw(port)
    words = f"board render {scene} -o {tmp_path / 'a.png'} --board {tmp_path} --size {FEW}"
    check_refused(capsys, f"{words} --port {os.ttyname(port)}", "the board does not answer")


def test_the_port_is_gone():
    """The board is unplugged: the error names the port, not a silent board."""
    here, port = os.openpty()
    name = os.ttyname(port)
    board = host.Host(name, TINY, {"registers": 0, "baud": 9600})
    os.close(here), os.close(port)
    for use in (lambda: board.get("ID"), lambda: board.put("CONTROL", 1)):
        with pytest.raises(InputError, match=f"^{name}: (?!the board)"):
            use()


def test_libraries(tmp_path, capsys, monkeypatch):
    """Without LiteX the message names the package to install, which is an extra."""
    monkeypatch.setattr(board_command, "find_spec", lambda name: None)
    check_refused(capsys, f"board write -o {tmp_path / 'b'}", r"pip install 'splatcore\[board\]'")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extra = extras["optional-dependencies"]["board"]
    assert {each.partition("==")[0].replace("-", "_") for each in extra} == {
        *board_command.LIBRARIES
    }


class Bus(host.Host):
    """A host whose bus is a dict of words, without a serial port."""

    def __init__(self):
        self.name, self.config, self.facts = "bus", TINY, {"start": []}
        self.at, self.words = addresses(TINY), {}
        self.words |= {self.at[name]: value for name, value in known(TINY).items()}

    def write(self, address, values):
        values = values if isinstance(values, list) else [values]
        self.words |= {address + 4 * k: value for k, value in enumerate(values)}

    def read(self, address, length=None):
        if length is None:
            return self.words[address]
        return [self.words[address + 4 * k] for k in range(length)]


def known(config) -> dict[str, int]:
    """Values of the constant registers."""
    return {each.name: each.value for each in control_registers(config) if each.value is not None}


def test_begin_aborts_a_running_frame(monkeypatch):
    """`begin` aborts a frame of another host and waits until STATUS is READY alone."""
    bus, states = Bus(), [READY | RENDERING, RENDERING, READY]
    read = bus.read

    def then(address, length=None):
        return states.pop(0) if address == bus.at["STATUS"] else read(address, length)

    monkeypatch.setattr(bus, "read", then)
    bus.begin()
    assert bus.words[bus.at["CONTROL"]] == ABORT and not states
    monkeypatch.setattr(host, "FRAME_SECONDS", 0.01)
    monkeypatch.setattr(
        bus, "read", lambda address: 0 if address == bus.at["STATUS"] else read(address)
    )
    with pytest.raises(InputError, match=r"bus: machine not ready within 0\.01 s"):
        bus.begin()


def test_a_frame_that_does_not_end(monkeypatch):
    """A frame that does not end in time is aborted."""
    monkeypatch.setattr(host, "FRAME_SECONDS", 0.01)
    bus = Bus()
    bus.words[bus.at["INTERRUPT"]] = 0
    with pytest.raises(InputError, match=r"bus: no frame within 0\.01 s"):
        bus._run()
    assert bus.words[bus.at["CONTROL"]] == ABORT


def test_load_and_fetch_any_length():
    """A model's last word is padded; the bytes that are read back are the ones written."""
    bus, calls = Bus(), []
    content = np.random.default_rng(1).integers(0, 256, 4 * 300 + 3, np.uint8)
    bus.load(256, content, lambda *each: calls.append(each))
    assert np.array_equal(bus.fetch(256, 4 * 301, lambda *each: calls.append(each))[:-1], content)
    assert calls[0] == (0, 1204) and calls[-1] == (1204, 1204)


# At the end of the file, as the simulated board stops after the last of them.


@pytest.mark.slow
def test_a_frame(board, scene, tmp_path, capsys):
    """Frames of two sizes and formats, without a reset in between, equal the golden model's."""
    folder, port = board
    for size, more, mode in (FEW, ["--rgba"], "RGBA"), ("17x33", [], "RGB"):
        picture, report = tmp_path / f"{size}.png", tmp_path / "report.json"
        words = ["--board", folder, "--port", port, "--size", size, *more]
        assert run("board", "render", scene, *words, "-o", picture, "--json", report) == 0
        assert "identical to the golden model" in capsys.readouterr().out
        facts = json.loads(report.read_text())
        with Image.open(picture) as image:
            assert facts["identical"] and image.mode == mode and [*image.size] == facts["size"]
        assert facts["frames_a_second"] == pytest.approx(
            5e7 / max(facts["preprocessing_cycles"], facts["rendering_cycles"]), abs=1e-3
        )
        assert facts["psnr_db_machine"] > 45
    check_documented("board render", facts.keys() - {"version"})


@pytest.mark.slow
def test_a_wrong_pixel_is_found(board, scene, tmp_path, capsys, monkeypatch):
    right = engines.golden

    def other(shot):
        frame = right(shot)
        frame.pixels[3, 5, 1] ^= 1
        return frame

    monkeypatch.setattr(engines, "golden", other)
    words = ["--board", board[0], "--port", board[1], "--size", FEW]
    assert run("board", "render", scene, *words, "-o", tmp_path / "a.png") == 1
    assert "1 pixels differ from the golden model" in capsys.readouterr().out


@pytest.mark.slow
def test_errors_are_reported(board, scene, tmp_path, capsys, monkeypatch):
    """The machine's error, too little memory and a wrong preset are reported; then a frame runs."""
    port, picture = board[1], tmp_path / "a.png"
    words = f"board render {scene} --port {port} --size {FEW} -o {picture} --board"
    memory = json.loads((board[0] / host.FACTS).read_text())["memory"]

    def short(*arguments):
        areas = place_in(*arguments)
        return replace(areas, registers=(areas.registers[0] | {"LISTS_PAGES": 1},))

    with monkeypatch.context() as patched:
        patched.setattr(host, "place_in", short)
        message = r"ERROR PAGES, detail 0, the lists need \d+ pages"
        check_refused(capsys, f"{words} {board[0]}", message)
    none = changed(board, tmp_path, memory=memory | {"bytes": 1 << 15})
    check_refused(capsys, f"{words} {none}", r"150 Gaussians at 40x24 take .* MiB")
    other = changed(board, tmp_path, preset="DEFAULT")
    check_refused(capsys, f"{words} {other}", "VERSION is 0x20005; preset DEFAULT has 0x5")
    assert not picture.exists()
    assert run(f"{words} {board[0]}") == 0
