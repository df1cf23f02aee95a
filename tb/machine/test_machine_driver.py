"""The example driver in C on the simulated machine: its frame is the golden model's."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from splatcore.eda.deliver.register_files import DRIVER, write_register_files
from splatcore.golden.pipeline import render
from splatcore.sim.machine.areas import BASE, Areas, make_memory
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import (
    CYCLES_MAX,
    IDLE_MAX,
    LPDDR4,
    Region,
    Report,
    Script,
    open_memory,
    prepare,
    read_report,
)
from splatcore.sim.soak.machines import machine
from splatcore.spec.axi import ADDRESS_BITS, window_bits
from splatcore.spec.config import TINY, Config
from splatcore.spec.work import PIXEL, aligned, scratch_bytes, stride, work
from tb.helpers.configs import wide_addresses
from tb.helpers.machines import garden, view

pytestmark = pytest.mark.slow

COMPILE = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]

MAIN = """\
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "splatcore_camera.h"
static uint32_t answer(void)
{
    char line[100];
    unsigned value, response;
    fflush(stdout);
    do
        if (!fgets(line, sizeof line, stdin)) exit(2);
    while (strncmp(line, "answer ", 7));
    if (sscanf(line, "answer %u %u", &value, &response) != 2 || response) exit(3);
    return value;
}
void splatcore_write(void *device, uint32_t address, uint32_t value)
{
    (void)device;
    printf("write %u %u\\n", (unsigned)address, (unsigned)value);
    answer();
}
uint32_t splatcore_read(void *device, uint32_t address)
{
    (void)device;
    printf("read %u\\n", (unsigned)address);
    return answer();
}
void splatcore_pause(void *device)
{
    (void)device;
    printf("cycles 100\\n");
    answer();
}
/* Two frames in flight, both complete before the driver reads INTERRUPT. */
static int32_t two_more(const struct splatcore_memory *memory, const struct splatcore_view *view)
{
    const uint32_t frames = splatcore_read(0, SPLATCORE_FINISHED) + 2;
    int32_t failed = splatcore_start(0, memory, view);
    if (!failed)
        failed = splatcore_ready(0, 10000);
    if (!failed)
        failed = splatcore_start(0, memory, view);
    for (int k = 0; k < 200; k++)
        splatcore_pause(0);
    return failed ? failed : splatcore_finished(0, frames, 10000);
}
int main(void)
{
    const uint8_t model[] = {@MODEL@};
    const struct splatcore_camera camera = {@CAMERA@};
    const double background[3] = {0.25, 0.5, 1};
    struct splatcore_memory memory = {@MEMORY@};
    struct splatcore_view view;
    int32_t failed = splatcore_open(0);
    splatcore_look(&view, &camera, model, background);
    if (!failed)
        failed = splatcore_frame(0, &memory, &view, @PAGES@, 10000);
    if (!failed)
        failed = two_more(&memory, &view);
    fprintf(stderr, "%d %u", (int)failed, (unsigned)memory.pages);
    return 0;
}
"""

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


def driver(config: Config, job: Job, areas: Areas, folder: Path) -> Path:
    """Compile the driver with a host's main function; the program's path."""
    write_register_files(config, folder)
    camera = job.camera
    rows = [*camera.rotation, camera.translation]
    braces = ["{" + ", ".join(float(value).hex() for value in row) + "}" for row in rows]
    numbers = [float(n).hex() for n in (camera.fx, camera.fy, camera.cx, camera.cy)]
    given = [str(camera.width), str(camera.height), *numbers]
    given += [f"{{{', '.join(braces[:3])}}}", braces[3], "0"]  # the usual near plane
    memory = [hex(region.begin) for region in areas.regions]
    memory += [str(FEW_PAGES), str(areas.features)]
    values = {"MODEL": job.model.image[:64], "CAMERA": given, "MEMORY": memory}
    main = MAIN.replace("@PAGES@", str(areas.pages))
    for name, value in values.items():
        main = main.replace(f"@{name}@", ", ".join(map(str, value)))
    (folder / "main.c").write_text(main)
    sources = [folder / name for name in ("main.c", *DRIVER) if name.endswith(".c")]
    command = [*COMPILE, f"-I{folder}", *sources, "-lm", "-o", folder / "driver"]
    subprocess.run(command, check=True)
    return folder / "driver"


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
    output, report = run(config, driver(config, job, areas, tmp_path), areas, tmp_path)
    assert output == f"0 {needed}" and report.done and not report.outside, (output, report.why)
    width, height = SIZE
    rows = areas.read(open_memory(tmp_path), "image0").reshape(height, stride(width))
    assert np.array_equal(rows[:, : width * PIXEL].reshape(frame.pixels.shape), frame.pixels)
