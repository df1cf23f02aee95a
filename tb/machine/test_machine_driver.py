"""The example driver in C on the simulated machine: its frame is the golden model's."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from splatcore.eda.deliver.register_files import write_register_files
from splatcore.eda.template import ENVIRONMENT
from splatcore.golden.pipeline import render
from splatcore.sim.machine.areas import BASE, Areas, make_memory
from splatcore.sim.machine.execute import CYCLES_MAX, IDLE_MAX, open_memory, prepare
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import LPDDR4, Region, Report, Script, read_report
from splatcore.sim.soak.machines import machine
from splatcore.spec.axi import ADDRESS_BITS, window_bits
from splatcore.spec.config import TINY, Config
from splatcore.spec.work import PIXEL, aligned, scratch_bytes, stride, work
from tb.helpers.c_host import camera_fields, compile_c, driver
from tb.helpers.command import ROOT
from tb.helpers.configs import wide_addresses
from tb.helpers.machines import garden, view

pytestmark = pytest.mark.slow

HOST = ENVIRONMENT.from_string((ROOT / "tb/helpers/machine_host.c.jinja").read_text())

FEW_PAGES = 2  # list pages at the start; the driver must increase them

SIZE = (48, 40)


def placed(config: Config, job: Job, pages: int) -> Areas:
    """Place model, work areas, scratch memory and image one after the other in the memory file;
    with 64-bit addresses each in its own window."""
    features, (width, height) = len(job.model), SIZE
    sizes = {
        "model0": len(job.model.image),
        "work": 2 * work(config, pages, features).size,
        "scratch": scratch_bytes(config),
        "image0": stride(width) * height,
    }
    regions, at = [], 0
    for k, (name, size) in enumerate(sizes.items()):
        window = 0x12345678 + k if window_bits(config) else 0
        address = BASE + at + (window << ADDRESS_BITS)
        regions.append(Region(name, address, size, name != "model0", at))
        at += aligned(size)
    starts = (regions[0].begin,), (regions[3].begin,)  # of model and image
    return Areas(starts[0], pages, features, (), starts[1], tuple(regions), BASE + at)


def compiled_host(config: Config, job: Job, areas: Areas, folder: Path) -> Path:
    """Compile a host with the driver; the program's path."""
    write_register_files(config, folder)
    objects = [*driver(folder), folder / "host.o"]
    memory = [*(hex(region.begin) for region in areas.regions), FEW_PAGES, areas.features]
    camera = camera_fields(job.camera).rpartition(", ")[0]
    camera += ", 0" * (1 + config.levels)  # the usual near plane, the finest level
    facts = {"model": job.model.image[:64], "camera": camera, "memory": memory}
    source = folder / "host.c"
    source.write_text(HOST.render(pages=areas.pages, **facts))
    compile_c(folder, source, "-c", "-o", objects[-1])
    subprocess.run(["gcc", *objects, "-lm", "-o", folder / "host"], check=True)
    return folder / "host"


def run(config: Config, program: Path, areas: Areas, folder: Path) -> tuple[str, Report]:
    """Run driver and machine, connected by pipes. Returns the driver's output and the report."""
    limits = {"idle_max": IDLE_MAX, "cycles_max": CYCLES_MAX, "live": 1}
    prepare(folder, Script(config), areas, LPDDR4, limits)
    given, answers = os.pipe()
    with subprocess.Popen(
        [program], stdin=given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as host:
        os.close(given)
        command = [machine(config).program, str(folder)]
        subprocess.run(command, stdin=host.stdout, stdout=answers, check=True)
        os.close(answers)
        output = host.stderr.read()
    assert host.returncode == 0, f"the host ended with {host.returncode}"
    return output, read_report(folder / "report", config)


@pytest.mark.parametrize("config", [TINY, wide_addresses(TINY)], ids=lambda config: config.name)
def test_driver_renders_a_frame(config, tmp_path):
    """The pixels are the golden model's, although list pages are too few at first; two more frames
    follow."""
    white = (256 << config.colour_fraction) / 255
    background = tuple(round(part * white) for part in (0.25, 0.5, 1))
    job = Job(garden(config, 150), view(*SIZE), background)
    frame = render(config, *job)
    needed = frame.binned.lists.needed
    assert needed > FEW_PAGES
    areas = placed(config, job, needed + 5)
    make_memory(tmp_path, areas, [job.model])
    output, report = run(config, compiled_host(config, job, areas, tmp_path), areas, tmp_path)
    assert output == f"0 {needed}" and report.done and not report.outside, (output, report.why)
    width, height = SIZE
    rows = areas.read(open_memory(tmp_path), "image0").reshape(height, stride(width))
    assert np.array_equal(rows[:, : width * PIXEL].reshape(frame.pixels.shape), frame.pixels)
