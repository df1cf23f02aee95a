"""The whole machine as a netlist of cells renders a frame as the golden model."""

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


@pytest.mark.verify
def test_frame(library):
    """`TINY` in one way of mapping, with memories as modules: every pixel is the golden model's."""
    work = pieces(netlist(TINY))
    texts = {piece.netlist.text: piece.netlist for piece in work}
    found = {text: mapped(each, library, effort=(1, 8)) for text, each in texts.items()}
    whole = put_together(library, {piece.path: found[piece.netlist.text] for piece in work})
    job = Job(pack(generate("needles"), TINY)[0], generated_camera("needles").resized(48, 32))
    run = Machine(TINY, simulated(whole)).run([job], LPDDR4)
    assert (run.frames[0].pixels == render(TINY, *job).pixels).all()
