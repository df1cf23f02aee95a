"""The whole machine as a netlist of cells renders a frame as the golden model."""

import re

import pytest

from splatcore.eda.cells.cell_models import simulated
from splatcore.eda.cells.cell_netlist import put_together
from splatcore.eda.cells.mapping import mapped
from splatcore.eda.gates.machine_gates import netlist, pieces
from splatcore.golden.pipeline import render
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.machine import Job, Machine
from splatcore.sim.machine.script import LPDDR4
from splatcore.spec.config import TINY

WRONG = (
    "preprocess.points.project.slots.ray", "preprocess.bin.lists.table", "render.sort.half0.values",
    "render.raster.rasterizer0.blend.sums.pixel0",
)  # fmt: skip
"""Memories; the gate before the first bit written into each can be wrong."""

CYCLES_MAX = 40_000  # a frame has 25,820; a wrong machine may never rest


def with_wrong_gates(text: str) -> str:
    """A netlist in which the argument +wrongN of the program inverts the gate before memory N."""
    for number, path in enumerate(WRONG):
        [net] = re.findall(rf"\\{re.escape(path)}\.macro .*?\.write_data\(\{{(\w+),", text)
        text, count = re.subn(
            rf"^  assign {net} = (.*);$",
            rf'  reg wrong{number};\n  initial wrong{number} = $test$plusargs("wrong{number}");\n'
            rf"  assign {net} = wrong{number} ^ (\1);",
            text,
            flags=re.M,
        )
        assert count == 1, path
    return text


@pytest.mark.verify
def test_frame(library, tmp_path):
    """`TINY` in one way of mapping, with memories as modules: every pixel is the golden model's,
    unless a gate is wrong."""
    work = pieces(netlist(TINY))
    texts = {piece.netlist.text: piece.netlist for piece in work}
    found = {text: mapped(each, library, effort=(1, 8)) for text, each in texts.items()}
    whole = put_together(library, {piece.path: found[piece.netlist.text] for piece in work})
    job = Job(pack(generate("needles"), TINY)[0], generated_camera("needles").resized(48, 32))
    right = render(TINY, *job).pixels
    machine = Machine(TINY, with_wrong_gates(simulated(whole)))
    assert (machine.run([job], LPDDR4).frames[0].pixels == right).all()

    program, machine.program = machine.program, tmp_path / "wrong"
    for number in range(len(WRONG)):
        machine.program.write_text(f'#!/bin/sh\nexec {program} "$@" +wrong{number}\n')
        machine.program.chmod(0o755)
        pixels = machine.run([job], LPDDR4, cycles_max=CYCLES_MAX).frames[0].pixels
        assert pixels is None or (pixels != right).any(), WRONG[number]
