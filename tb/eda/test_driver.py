"""The example driver in C on a simulated register file, against `spec.registers`."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from splatcore.eda.template import ENVIRONMENT
from splatcore.spec import registers
from splatcore.spec.axi import ADDRESS_BITS
from splatcore.spec.camera import Camera
from splatcore.spec.config import DEFAULT, PAPER, TINY
from splatcore.spec.frame import frame_constants
from splatcore.spec.memory import HEADER
from splatcore.spec.record import Array
from splatcore.spec.registers import START, ErrorCode, addresses, register_map
from splatcore.spec.work import scratch_bytes, stride, work
from tb.helpers.c_host import STRICT, camera_fields, host_lines
from tb.helpers.command import ROOT
from tb.helpers.configs import ALPHA

HOST = ENVIRONMENT.from_string((ROOT / "tb/helpers/driver_host.c.jinja").read_text())

NO_DEVICE, NO_FRAME, TIMEOUT = -1, -2, -3

PLACES = ("MODEL", "GROUPS", "SCRATCH", "PIXELS")

FRAME = "failed = splatcore_frame(&machine, &memory, &view, 20, 5);"
WAIT = 'printf("%d\\n", (int)splatcore_wait(&machine, SPLATCORE_INTERRUPT_FRAME, 0));'


def camera(seed: int, width: int = 64, height: int = 48) -> Camera:
    """A random camera."""
    random = np.random.default_rng(seed)
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
    focal, centre = random.uniform(40, 2000, 2), random.uniform(10, 60, 2)
    near, place = random.choice([0.2, 0.01, 3e-5, 1.7]), random.normal(0, 30, 3)
    return Camera(width, height, *focal, *centre, rotation, place, "", near, 0.7 * seed)


class Run(NamedTuple):
    """Register writes as (address, value); other results that the host prints; the driver's."""

    writes: list[tuple[int, int]]
    results: list[int]
    failed: int

    def of(self, address: int) -> list[int]:
        """Values written to a register."""
        return [value for at, value in self.writes if at == address]


def driven(
    folder: Path,
    view: Camera | None = None,
    config=TINY,
    exponents: tuple[int, int] = (-8, 0),
    calls: str = FRAME,
    **machine: int,
) -> Run:
    """Run a C host that drives a simulated machine.

    folder: of the machine's register files
    calls: the host's statements after it has opened the driver
    machine: changed fields of the simulated machine; without them the frame succeeds. In pauses:
        ready_after, from the opening to READY; frame_points and frame_tiles, of a frame's halves
    """
    values = dict(zip(("position_exponent", "factor_exponent"), exponents, strict=True))
    codes = {
        name: np.zeros((1, format.length) if isinstance(format, Array) else 1, np.uint64)
        for name, format in HEADER.fields
    } | {name: HEADER[name].encode(np.array([value])) for name, value in values.items()}
    given = {"id": "SPLATCORE_ID_VALUE", "version": "SPLATCORE_VERSION_VALUE", "ready_after": 2}
    given |= {"finished": 0, "frame_points": 2, "frame_tiles": 3, "need": 0, "error": 0} | machine
    host = HOST.render(
        model=", ".join(map(str, HEADER.pack(codes)[0])),
        camera=camera_fields(view or camera(0), config.levels),
        memory=", ".join(map(hex, places(config).values())),
        machine=", ".join([*map(str, given.values()), *"000000000"]),
        first=registers.FRAME_START,
        calls=calls,
    )
    lines = [tuple(map(int, line.split())) for line in host_lines(folder, host)]
    results = [line[0] for line in lines if len(line) == 1]
    return Run([line for line in lines if len(line) == 2], results[:-1], results[-1])


def places(config) -> dict[str, int]:
    """Addresses of model, work areas, scratch memory and image, each in its own window.

    With 64-bit addresses the work areas straddle the end of a window.
    """
    places = dict(zip(PLACES, range(0x1000000, 0x5000000, 0x1000000), strict=True))
    if config.address_bits == 32:
        return places
    places |= {name: at + (at * 0xABCD << 8) for name, at in places.items()}
    end = -(-places["GROUPS"] // (1 << ADDRESS_BITS)) << ADDRESS_BITS
    return places | {"GROUPS": end - work(config, 7, 100).lists}


def test_driver_writes_what_the_spec_says(files):
    """The driver writes all registers of a frame, then START; camera values are bit-exact."""
    config, folder = files
    names = {at: register.name for at, register in register_map(config).items()}
    frame = {r.name for r in register_map(config).values() if r.access == "frame"}
    for seed in range(4):
        view, exponents = camera(seed), (-8 - seed, seed)
        run = driven(folder, view, config, exponents)
        assert run.failed == 0
        order = [names[address] for address, _ in run.writes]
        assert frame <= set(order[: order.index("CONTROL")])
        got = {names[at]: value for at, value in run.writes}
        expected = registers.camera_values(config, frame_constants(config, view, *exponents))
        area, placed = work(config, 7, 100), places(config)
        placed |= {"LISTS": placed["GROUPS"] + area.lists}
        placed |= {"FEATURES": placed["GROUPS"] + area.features}
        for name, place in placed.items():
            expected |= registers.address_values(config, name, place)
        expected |= {"WORK_AREA": area.size, "STRIDE": stride(64), "CONTROL": START}
        white = (256 << config.colour_fraction) / 255
        for name, value in {"RED": 0, "GREEN": white / 2, "BLUE": white}.items():
            expected[f"BACKGROUND_{name}"] = round(value)
        assert {name: got[name] for name in expected} == expected
    text = (folder / "splatcore.h").read_text()
    assert f"SPLATCORE_SCRATCH_BYTES {scratch_bytes(config)}u" in text


@pytest.mark.parametrize("rgba", [False, True])
def test_driver_writes_the_format(rgba, register_files):
    """FORMAT, RGB unless set, and the smallest STRIDE of the format."""
    calls = f"view.format = SPLATCORE_FORMAT_RGBA; {FRAME}" if rgba else FRAME
    run = driven(register_files[ALPHA], camera(0, width=57), ALPHA, calls=calls)
    at = addresses(ALPHA)
    assert run.failed == 0 and run.of(at["FORMAT"]) == [rgba]
    assert run.of(at["STRIDE"]) == [stride(57, rgba)] != [stride(57, not rgba)]


@pytest.mark.parametrize(("need", "pages", "failed"), [(12, [7, 12], 0), (21, [7], 0x10008)])
def test_driver_retries_with_the_needed_pages(tiny_files, need, pages, failed):
    run = driven(tiny_files, need=need)
    assert run.of(addresses(TINY)["LISTS_PAGES"]) == pages
    assert run.failed == failed and ErrorCode.PAGES == 8


@pytest.mark.parametrize(
    "machine, expected, abort",
    [
        pytest.param({"id": 1}, NO_DEVICE, False, id="another_id"),
        pytest.param({"version": 99}, NO_DEVICE, False, id="another_version"),
        pytest.param({"ready_after": 6}, TIMEOUT, True, id="never_ready"),
        pytest.param({"frame_tiles": 4}, TIMEOUT, True, id="never_a_frame"),
        pytest.param({"error": 0x2060A}, 0x2060A, False, id="an_error"),
    ],
)
def test_failures_are_returned(machine, expected, abort, tiny_files):
    """Changed machine fields, the driver's result, and whether it writes ABORT."""
    run = driven(tiny_files, **machine)
    assert run.failed == expected
    assert (run.of(addresses(TINY)["CONTROL"])[-1:] == [registers.ABORT]) == abort
    assert bool(run.writes) == (expected != NO_DEVICE)
    if expected > 0:
        assert expected in run.of(addresses(TINY)["ERROR"])


@pytest.mark.parametrize("points", [1, 4, 5])
def test_ready_does_not_end_the_pauses_of_a_wait_for_the_frame(points, tiny_files):
    assert driven(tiny_files, frame_points=points, frame_tiles=5 - points).failed == 0


@pytest.mark.parametrize("event", ["READY", "FRAME", "ERROR"])
def test_pending_events_do_not_end_the_pauses_of_ready_and_stay(event, tiny_files):
    pending = (
        f"machine.interrupt = SPLATCORE_INTERRUPT_{event}; machine.held = {event == 'ERROR':d};"
    )
    ready = "failed = splatcore_ready(&machine, 3);"
    run = driven(tiny_files, calls=pending + ready + WAIT, ready_after=3)
    assert run.failed == 0
    assert run.results == [{"READY": TIMEOUT, "FRAME": 0, "ERROR": ErrorCode.START}[event]]


@pytest.mark.parametrize(("after", "second"), [("read", 0x30000), ("write", 0x1000B)])
def test_an_error_while_the_driver_clears_another_one_is_not_lost(after, second, tiny_files):
    """Nor is a pending FRAME. The code is lost if the error precedes the write of ERROR."""
    pending = "machine.interrupt = SPLATCORE_INTERRUPT_FRAME; fail(&machine, 0x2060A);"
    late = f"machine.late = 0x1000B; machine.late_after = {1 + (after == 'write')};"
    run = driven(tiny_files, calls=pending + late + 3 * WAIT)
    assert [*run.results, run.failed] == [0x2060A, second, 0, 0]


TWO = """\
failed = splatcore_ready(&machine, 20);
for (int k = 0; k < 2; k++) {
    failed = failed ? failed : splatcore_start(&machine, &memory, &view);
    failed = failed ? failed : splatcore_ready(&machine, 20);
}
"""
"""Start two frames, the second one while the first is rendered."""

LATER = "for (int k = 0; k < 20; k++) splatcore_pause(&machine);\n"  # both frames end
EVENTS = 'printf("%d\\n%d\\n", (int)machine.interrupt, (int)machine.held);'


def check_finished(folder: Path):
    """`splatcore_finished` returns when FINISHED is `frames`, modulo 2^16, also if both frames are
    complete before; and never if a frame is missing."""
    found = 'printf("%d\\n", (int)splatcore_read(&machine, SPLATCORE_FINISHED));'
    for start, frames, later in ((0, 1, ""), (0, 3, ""), (0xFFFE, 2, ""), (0xFFFF, 2, LATER)):
        end = f"failed = splatcore_finished(&machine, {start + frames & 0xFFFF}, 20);\n"
        run = driven(folder, calls=TWO + later + end + found, finished=start, frame_tiles=9)
        right = min(frames, 2), TIMEOUT if frames == 3 else 0
        assert (run.results[0] - start & 0xFFFF, run.failed) == right, (start, frames, later)


def check_events(folder: Path):
    """After an error its bit and ERROR are cleared, and READY and FRAME stay; a wait clears only
    the event that it waited for."""
    pending = "machine.interrupt = SPLATCORE_INTERRUPT_READY | SPLATCORE_INTERRUPT_FRAME;"
    error = "fail(&machine, 0x2060A);"
    calls = pending + error + WAIT + EVENTS + WAIT + EVENTS + WAIT
    results = [0x2060A, 3, 0, 0, 1, 0, TIMEOUT]
    assert driven(folder, calls=calls).results == results
    run = driven(folder, calls=pending + WAIT.replace("_FRAME", "_READY") + EVENTS + WAIT)
    assert run.results == [0, 2, 0, 0]
    run = driven(folder, calls=pending + error + "failed = splatcore_ready(&machine, 3);" + EVENTS)
    assert (run.results, run.failed) == ([6, 0x2060A], 0)


def test_finished(tiny_files):
    check_finished(tiny_files)


def test_events_stay_until_waited_for(tiny_files):
    check_events(tiny_files)


FAULTS = {
    "finished_early": (check_finished, "_FINISHED) - 1)", "_FINISHED) - 2)"),
    "finished_late": (check_finished, "_FINISHED) - 1)", "_FINISHED))"),
    "no_modulo": (check_finished, "- 1) & 0x8000", "- 1) & 0x80000000"),
    "the_error_stays": (check_events, "splatcore_write(device, SPLATCORE_ERROR, error);", ""),
    "its_event_stays": (
        check_events, "splatcore_write(device, SPLATCORE_INTERRUPT, SPLATCORE_INTERRUPT_ERROR);", ""
    ),
    "an_error_clears_all": (
        check_events, "_INTERRUPT, SPLATCORE_INTERRUPT_ERROR)",
        "_INTERRUPT, SPLATCORE_INTERRUPT_MASK)",
    ),
    "a_wait_clears_all": (check_events, "now & events);", "now);"),
    "ready_clears_all": (
        check_events, "SPLATCORE_INTERRUPT, SPLATCORE_INTERRUPT_READY)",
        "SPLATCORE_INTERRUPT, SPLATCORE_INTERRUPT_MASK)",
    ),
}  # fmt: skip
"""Faults in the driver: the check that finds each, text of the driver, new text."""


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_found(fault, tiny_files, tmp_path):
    check, old, new = FAULTS[fault]
    folder = shutil.copytree(tiny_files, tmp_path / "files", ignore=shutil.ignore_patterns("*.o"))
    text = (folder / "splatcore_driver.c").read_text()
    assert text.count(old) == 1
    (folder / "splatcore_driver.c").write_text(text.replace(old, new))
    with pytest.raises(AssertionError):
        check(folder)


@pytest.mark.parametrize("side", ["width", "height"])
def test_an_image_that_is_too_large_is_refused(side, tiny_files):
    run = driven(tiny_files, camera(0, **{side: 65}))
    assert run.failed == NO_FRAME
    assert not run.of(addresses(TINY)["CONTROL"])


def test_the_kernel_part_stands_alone(files, tmp_path):
    """The kernel part compiles without a C library and uses no floating point."""
    _, folder = files
    find = ["gcc", "-print-file-name=include"]  # the compiler's own headers, which it may use
    include = subprocess.run(find, capture_output=True, text=True, check=True).stdout.strip()
    kernel = ["gcc", "-std=c99", *STRICT, "-ffreestanding", "-nostdinc", "-isystem", include]
    kernel.append(folder / "splatcore_driver.c")
    subprocess.run([*kernel, "-c", "-o", tmp_path / "driver.o"], check=True)
    text = subprocess.run([*kernel, "-E"], capture_output=True, text=True, check=True).stdout
    assert "splatcore_frame" in text and not re.search(r"\b(double|float)\b|math\.h", text)
    user = "".join((folder / f"splatcore_camera.{end}").read_text() for end in "ch")
    assert "double" in user


NUMBERS = """\
#include <stdio.h>
#include "splatcore_camera.h"
int main(void)
{
    const double values[] = {@VALUES@};
    for (unsigned k = 0; k < sizeof values / sizeof *values; k++)
        printf("%u\\n", splatcore_number(values[k]));
    return 0;
}
"""


@pytest.mark.parametrize("config", (DEFAULT, PAPER), ids=lambda config: config.name)
def test_numbers(config, register_files):
    """`splatcore_number` rounds like the format: ties, limits, underflow and overflow."""
    format, random = config.arithmetic, np.random.default_rng(0)
    codes = random.integers(1, 1 << format.width - 1, 300)
    codes = codes[np.isfinite(format.decode(codes)) & np.isfinite(format.decode(codes + 1))]
    near = format.decode(codes)
    values = np.concatenate([near, (near + format.decode(codes + 1)) / 2, -near])
    ends = [format.max, format.min_normal, format.min_subnormal]
    ends = np.array([end * k for end in ends for k in (0.25, 0.5, 0.50001, 0.75, 1, 1.00001, 2)])
    values = np.concatenate([values, ends, -ends, [0.0, -0.0, 1e300, -np.inf, np.inf, 1e-300]])
    text = ", ".join(v.hex().replace("inf", "HUGE_VAL") for v in values.tolist())
    host = NUMBERS.replace("@VALUES@", text)
    lines = host_lines(register_files[config], host, with_driver=False)
    assert list(map(int, lines)) == format.encode(values).tolist()
