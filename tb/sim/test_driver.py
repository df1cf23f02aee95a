"""The example driver in C on a simulated register file, against `spec.registers`."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from splatcore.sim.eda.register_files import write_register_files
from splatcore.spec import registers
from splatcore.spec.axi import ADDRESS_BITS
from splatcore.spec.camera import Camera
from splatcore.spec.config import DEFAULT, PAPER, TINY
from splatcore.spec.frame import frame_constants
from splatcore.spec.memory import HEADER
from splatcore.spec.record import Array
from splatcore.spec.registers import START, ErrorCode, addresses, register_map
from splatcore.spec.work import scratch_bytes, stride, work
from tb.helpers.configs import MAPS
from tb.helpers.driver_host import MAIN

COMPILE = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]

NO_DEVICE, NO_FRAME, TIMEOUT = -1, -2, -3

PLACES = ("MODEL", "GROUPS", "SCRATCH", "PIXELS")


@pytest.fixture(params=MAPS, ids=lambda config: config.name)
def files(request, tmp_path):
    """A machine, and the folder with its generated files."""
    write_register_files(request.param, tmp_path)
    return request.param, tmp_path


def run(folder: Path, name: str, main: str) -> list[tuple[int, ...]]:
    """Compile and run a C program with the driver; return its lines of integers."""
    (folder / f"{name}.c").write_text(main)
    sources = [folder / f for f in (f"{name}.c", "splatcore_driver.c", "splatcore_camera.c")]
    if "splatcore_open" not in main:
        sources = [sources[0]]
    subprocess.run([*COMPILE, f"-I{folder}", *sources, "-lm", "-o", folder / name], check=True)
    done = subprocess.run([folder / name], capture_output=True, text=True, check=True)
    return [tuple(map(int, line.split())) for line in done.stdout.splitlines()]


def camera(seed: int) -> Camera:
    """A random camera."""
    random = np.random.default_rng(seed)
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
    focal, centre = random.uniform(40, 2000, 2), random.uniform(10, 60, 2)
    near = random.choice([0.2, 0.01, 3e-5, 1.7])
    return Camera(64, 48, *focal, *centre, rotation, random.normal(0, 30, 3), "", near)


def example(
    config,
    view: Camera,
    exponents: tuple[int, int] = (-8, 0),
    calls: str = "failed = splatcore_frame(&machine, &memory, &view, 20, 5);",
    **machine: int,
) -> str:
    """Return a C host that prints each register write, then the driver's result.

    calls: the host's statements after it has opened the driver
    machine: changed fields of the simulated machine; without them the frame succeeds. In pauses:
        ready_after, from the opening to READY; points and frame_after, from START to READY and to
        the frame's end
    """
    values = {"position_exponent": exponents[0], "factor_exponent": exponents[1]}
    codes = {
        name: np.zeros((1, format.length) if isinstance(format, Array) else 1, np.uint64)
        for name, format in HEADER.fields
    } | {name: HEADER[name].encode(np.array([value])) for name, value in values.items()}
    numbers = [view.width, view.height, view.fx, view.fy, view.cx, view.cy]
    rows = [*view.rotation, view.translation]
    braces = ["{" + ", ".join(float(v).hex() for v in row) + "}" for row in rows]
    text = ", ".join(str(v) if isinstance(v, int) else float(v).hex() for v in numbers)
    text += f", {{{', '.join(braces[:3])}}}, {braces[3]}, {float(view.near).hex()}"
    given = {"id": "SPLATCORE_ID_VALUE", "version": "SPLATCORE_VERSION_VALUE", "ready_after": 2}
    given |= {"points": 2, "frame_after": 5, "need": 0, "error": 0} | machine
    image = ", ".join(map(str, HEADER.pack(codes)[0]))
    main = MAIN.replace("@MACHINE@", ", ".join([*map(str, given.values()), *"0000000"]))
    main = main.replace("@CALLS@", calls)
    main = main.replace("@MEMORY@", ", ".join(map(hex, places(config).values())))
    return main.replace("@MODEL@", image).replace("@CAMERA@", text)


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
    frame = [at for at, register in register_map(config).items() if register.access == "frame"]
    names = {at: register.name for at, register in register_map(config).items()}
    for seed in range(4):
        view, exponents = camera(seed), (-8 - seed, seed)
        *lines, (failed,) = run(folder, f"frame{seed}", example(config, view, exponents))
        assert failed == 0
        order = [address for address, _ in lines]
        start = order.index(addresses(config)["CONTROL"])
        assert set(frame) <= set(order[:start])
        got = {names[at]: value for at, value in lines}
        expected = registers.camera_values(config, frame_constants(config, view, *exponents))
        assert {name: got[name] for name in expected} == expected
        area, placed = work(config, 7, 100), places(config)
        placed |= {"LISTS": placed["GROUPS"] + area.lists}
        placed |= {"FEATURES": placed["GROUPS"] + area.features}
        for name, place in placed.items():
            values = registers.address_values(config, name, place)
            assert {register: got[register] for register in values} == values
        assert got["WORK_AREA"] == area.size
        assert got["STRIDE"] == stride(64) and got["CONTROL"] == START
        background = [got[f"BACKGROUND_{name}"] for name in ("RED", "GREEN", "BLUE")]
        white = (256 << config.colour_fraction) / 255
        assert background == [0, round(white / 2), round(white)]
    text = (folder / "splatcore.h").read_text()
    assert f"SPLATCORE_SCRATCH_BYTES {scratch_bytes(config)}u" in text


@pytest.mark.parametrize(("need", "pages", "failed"), [(12, [7, 12], 0), (21, [7], 8)])
def test_driver_retries_with_the_needed_pages(tmp_path, need, pages, failed):
    write_register_files(TINY, tmp_path)
    *lines, (result,) = run(tmp_path, "pages", example(TINY, camera(0), need=need))
    at = addresses(TINY)["LISTS_PAGES"]
    assert [value for address, value in lines if address == at] == pages
    assert result == failed and ErrorCode.PAGES == 8


WRONG = {
    "another_id": ({"id": 1}, NO_DEVICE, False),
    "another_version": ({"version": 99}, NO_DEVICE, False),
    "never_ready": ({"ready_after": 6}, TIMEOUT, True),
    "never_a_frame": ({"frame_after": 6}, TIMEOUT, True),
    "an_error": ({"error": 0x2060A}, 0x2060A, False),
}
"""Changed machine fields, the driver's result, and whether it writes ABORT."""


@pytest.mark.parametrize("name", WRONG)
def test_failures_are_returned(name, tmp_path):
    machine, expected, abort = WRONG[name]
    write_register_files(TINY, tmp_path)
    *lines, (failed,) = run(tmp_path, name, example(TINY, camera(0), **machine))
    assert failed == expected
    control = [value for address, value in lines if address == addresses(TINY)["CONTROL"]]
    assert (control[-1:] == [registers.ABORT]) == abort
    assert lines if expected != NO_DEVICE else not lines
    if expected > 0:
        assert (addresses(TINY)["ERROR"], expected) in lines


WAIT = 'printf("%d\\n", (int)splatcore_wait(&machine, SPLATCORE_INTERRUPT_FRAME, 0));'


def results(folder: Path, name: str, *calls: str, **machine: int) -> list[int]:
    """Return the results that a host with these calls prints."""
    write_register_files(TINY, folder)
    lines = run(folder, name, example(TINY, camera(0), calls="\n".join(calls), **machine))
    return [line[0] for line in lines if len(line) == 1]


@pytest.mark.parametrize("points", [1, 4, 5])
def test_ready_does_not_end_the_pauses_of_a_wait_for_the_frame(points, tmp_path):
    write_register_files(TINY, tmp_path)
    *_, (failed,) = run(tmp_path, "early", example(TINY, camera(0), points=points))
    assert failed == 0


@pytest.mark.parametrize("event", ["READY", "FRAME", "ERROR"])
def test_pending_events_do_not_end_the_pauses_of_ready_and_stay(event, tmp_path):
    pending = (
        f"machine.interrupt = SPLATCORE_INTERRUPT_{event}; machine.held = {int(event == 'ERROR')};"
    )
    ready = "failed = splatcore_ready(&machine, 3);"
    *waits, failed = results(tmp_path, "pending", pending, ready, WAIT, ready_after=3)
    assert failed == 0
    assert waits == [{"READY": TIMEOUT, "FRAME": 0, "ERROR": ErrorCode.START}[event]]


@pytest.mark.parametrize(("after", "second"), [("read", 0x30000), ("write", 0x1000B)])
def test_an_error_while_the_driver_clears_another_one_is_not_lost(after, second, tmp_path):
    """Nor is a pending FRAME. The code is lost if the error precedes the write of ERROR."""
    pending = "machine.interrupt = SPLATCORE_INTERRUPT_FRAME; fail(&machine, 0x2060A);"
    late = f"machine.late = 0x1000B; machine.late_after = {1 + (after == 'write')};"
    assert results(tmp_path, after, pending, late, *[WAIT] * 3) == [0x2060A, second, 0, 0]


@pytest.mark.parametrize("side", ["width", "height"])
def test_an_image_that_is_too_large_is_refused(side, tmp_path):
    write_register_files(TINY, tmp_path)
    view = {"width": 64, "height": 48} | {side: 65}
    of = camera(0)
    large = Camera(*view.values(), of.fx, of.fy, of.cx, of.cy, of.rotation, of.translation)
    *lines, (failed,) = run(tmp_path, side, example(TINY, large))
    assert failed == NO_FRAME
    assert addresses(TINY)["CONTROL"] not in [address for address, _ in lines]


def test_the_kernel_part_stands_alone(files):
    """The kernel part compiles without a C library and uses no floating point."""
    _, folder = files
    kernel = [
        *COMPILE,
        "-ffreestanding",
        "-nostdinc",
        "-isystem",
        include(),
        folder / "splatcore_driver.c",
    ]
    subprocess.run([*kernel, "-c", "-o", folder / "driver.o"], check=True)
    text = subprocess.run([*kernel, "-E"], capture_output=True, text=True, check=True).stdout
    assert "splatcore_frame" in text and not re.search(r"\b(double|float)\b|math\.h", text)
    user = "".join((folder / f"splatcore_camera.{end}").read_text() for end in "ch")
    assert "double" in user


def include() -> str:
    """Folder of the compiler's own headers, which freestanding programs may use."""
    command = ["gcc", "-print-file-name=include"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.parametrize("config", (DEFAULT, PAPER), ids=lambda config: config.name)
def test_numbers(config, tmp_path):
    """`splatcore_number` rounds like the format: ties, limits, underflow and overflow."""
    write_register_files(config, tmp_path)
    format, random = config.arithmetic, np.random.default_rng(0)
    codes = random.integers(1, 1 << format.width - 1, 300)
    codes = codes[np.isfinite(format.decode(codes)) & np.isfinite(format.decode(codes + 1))]
    near = format.decode(codes)
    values = np.concatenate([near, (near + format.decode(codes + 1)) / 2, -near])
    ends = [format.max, format.min_normal, format.min_subnormal]
    ends = np.array([end * k for end in ends for k in (0.25, 0.5, 0.50001, 0.75, 1, 1.00001, 2)])
    values = np.concatenate([values, ends, -ends, [0.0, -0.0, 1e300, -np.inf, np.inf, 1e-300]])
    text = ", ".join(str(v).replace("inf", "HUGE_VAL") if np.isinf(v) else v.hex()
                     for v in values.tolist())  # fmt: skip
    main = f"""#include <stdio.h>
#include "splatcore_camera.h"
int main(void)
{{
    const double values[] = {{{text}}};
    for (unsigned k = 0; k < {len(values)}; k++) printf("%u\\n", splatcore_number(values[k]));
    return 0;
}}
"""
    got = [code for (code,) in run(tmp_path, "numbers", main)]
    assert got == format.encode(values).tolist()
