"""The registers' page and C header; the C example against `spec.registers`."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from splatcore.sim.eda.register_files import sizes, write_register_files
from splatcore.spec import registers
from splatcore.spec.axi import RENDERING
from splatcore.spec.camera import Camera
from splatcore.spec.config import DEFAULT, PAPER, PRESETS, TINY
from splatcore.spec.frame import frame_constants
from splatcore.spec.memory import HEADER
from splatcore.spec.record import Array
from splatcore.spec.registers import READY, START, ErrorCode, register_map
from splatcore.spec.work import scratch_bytes, stride, work

EXAMPLE = Path(__file__).parents[2] / "docs" / "example_frame.c"

COMPILE = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]

MAIN = """\
#include <stdio.h>
#include "@EXAMPLE@"
static uint32_t need;
void splatcore_write(uint32_t address, uint32_t value) { printf("%u %u\\n", address, value); }
uint32_t splatcore_read(uint32_t address)
{
    switch (address) {
    case SPLATCORE_STATUS: return SPLATCORE_STATUS_READY;
    case SPLATCORE_INTERRUPT: return need ? SPLATCORE_INTERRUPT_ERROR : SPLATCORE_INTERRUPT_FRAME;
    case SPLATCORE_ERROR: return SPLATCORE_ERROR_PAGES;
    case SPLATCORE_NEEDED: { uint32_t found = need; need = 0; return found; }
    }
    return 0;
}
void splatcore_sleep(void) {}
int main(void)
{
    const uint8_t model[] = {@MODEL@};
    const struct camera camera = {@CAMERA@};
    const double background[3] = {0, 0.5, 1};
    struct memory memory = {0x1000000, 0x2000000, 0x3000000, 0x4000000, 7, 100};
    need = @NEED@;
    return (int)splatcore_frame(&camera, &memory, 20, model, background);
}
"""


@pytest.fixture(params=PRESETS.values(), ids=lambda config: config.name)
def files(request, tmp_path):
    """A machine, and the folder of its files."""
    paths = write_register_files(request.param, tmp_path)
    assert [path.name for path in paths] == ["registers.md", "splatcore.h"]
    return request.param, tmp_path


def defines(folder: Path) -> dict[str, int]:
    """Whole numbers of the header by name, as the preprocessor has them."""
    text = subprocess.run(
        ["gcc", "-E", "-dM", folder / "splatcore.h"], capture_output=True, text=True, check=True
    ).stdout
    found = re.findall(r"^#define SPLATCORE_(\w+) (0x[0-9a-f]+|\d+)u$", text, re.M)
    return {name: int(value, 0) for name, value in found}


def test_header(files):
    config, folder = files
    found = defines(folder)
    for address, register in register_map(config).items():
        assert found[register.name] == address
        if register.width < 32:
            assert found[f"{register.name}_MASK"] == (1 << register.width) - 1
        if register.value is not None:
            assert found[f"{register.name}_VALUE"] == register.value
    assert (found["CONTROL_START"], found["CONTROL_ABORT"]) == (START, registers.ABORT)
    assert (found["STATUS_READY"], found["STATUS_RENDERING"]) == (READY, registers.RENDERING)
    assert found["INTERRUPT_FRAME"] == registers.INTERRUPT_FRAME
    assert found["ERROR_RENDERING"] == 1 << registers.HALVES_AT + RENDERING
    assert found["READER_FEATURES"] == 6 and found["WRITER_PIXELS"] == 4
    text = (folder / "splatcore.h").read_text()
    assert all(f"SPLATCORE_ERROR_{code.name} = {code.value}," in text for code in ErrorCode)
    assert found.items() >= sizes(config).items()


def test_page(files):
    config, folder = files
    text = (folder / "registers.md").read_text()
    for address, register in register_map(config).items():
        assert f"| {address:#05x} | {register.name} | {register.width} |" in text
    for code in ErrorCode:
        (meaning,) = re.findall(rf"^\| {code.value} \| {code.name} \| (.+?) \|", text, re.M)
        assert len(meaning) > 5


def run(config, folder: Path, name: str, main: str, *, status: int = 0) -> list[tuple[int, ...]]:
    """Lines of whole numbers that a C program prints."""
    (folder / f"{name}.c").write_text(main)
    shutil.copy(EXAMPLE, folder)  # another machine's header may lie beside the original
    program = folder / name
    sources = [f"-I{folder}", folder / f"{name}.c", "-lm", "-o", program]
    subprocess.run([*COMPILE, *sources], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == status
    return [tuple(map(int, line.split())) for line in done.stdout.splitlines()]


def camera(seed: int) -> Camera:
    """Somewhere, turned somehow."""
    random = np.random.default_rng(seed)
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
    focal, centre = random.uniform(40, 2000, 2), random.uniform(10, 60, 2)
    return Camera(64, 48, *focal, *centre, rotation, random.normal(0, 30, 3))


def example(config, view: Camera, exponents: tuple[int, int], need: int = 0) -> str:
    """The example with a host around it that prints what is written to registers."""
    values = {"position_exponent": exponents[0], "factor_exponent": exponents[1]}
    codes = {
        name: np.zeros((1, format.length) if isinstance(format, Array) else 1, np.uint64)
        for name, format in HEADER.fields
    } | {name: HEADER[name].encode(np.array([value])) for name, value in values.items()}
    numbers = [view.width, view.height, view.fx, view.fy, view.cx, view.cy]
    rows = [*view.rotation, view.translation]
    braces = ["{" + ", ".join(float(v).hex() for v in row) + "}" for row in rows]
    text = ", ".join(str(v) if isinstance(v, int) else float(v).hex() for v in numbers)
    text += f", {{{', '.join(braces[:3])}}}, {braces[3]}"
    main = MAIN.replace("@EXAMPLE@", EXAMPLE.name).replace("@NEED@", str(need))
    image = ", ".join(map(str, HEADER.pack(codes)[0]))
    return main.replace("@MODEL@", image).replace("@CAMERA@", text)


def test_example_writes_what_the_spec_says(files):
    """All registers of a frame, and the camera's numbers to the last bit."""
    config, folder = files
    frame = [at for at, register in register_map(config).items() if register.access == "frame"]
    names = {at: register.name for at, register in register_map(config).items()}
    for seed in range(4):
        view, exponents = camera(seed), (-8 - seed, seed)
        lines = run(config, folder, f"frame{seed}", example(config, view, exponents))
        written = dict(lines)
        assert set(frame) <= set(written)
        got = {names[at]: value for at, value in written.items()}
        expected = registers.camera_values(config, frame_constants(config, view, *exponents))
        assert {name: got[name] for name in expected} == expected
        area = work(config, 7, 100)
        assert got["LISTS"] - got["GROUPS"] == area.lists and got["WORK_AREA"] == area.size
        assert got["FEATURES"] - got["GROUPS"] == area.features
        assert defines(folder)["SCRATCH_BYTES"] == scratch_bytes(config)
        assert got["STRIDE"] == stride(64) and got["CONTROL"] == START
        background = [got[f"BACKGROUND_{name}"] for name in ("RED", "GREEN", "BLUE")]
        white = (256 << config.colour_fraction) / 255
        assert background == [0, round(white / 2), round(white)]


@pytest.mark.parametrize(
    ("need", "pages", "status"), [(12, [7, 12], 0), (21, [7], ErrorCode.PAGES)]
)
def test_example_takes_as_many_pages_as_are_needed(tmp_path, need, pages, status):
    write_register_files(TINY, tmp_path)
    lines = run(TINY, tmp_path, "pages", example(TINY, camera(0), (-8, 0), need), status=status)
    at = defines(tmp_path)["LISTS_PAGES"]
    assert [value for address, value in lines if address == at] == pages


@pytest.mark.parametrize("config", (DEFAULT, PAPER), ids=lambda config: config.name)
def test_numbers(config, tmp_path):
    """Ties, ends and what is too small or too large."""
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
#include "splatcore.h"
int main(void)
{{
    const double values[] = {{{text}}};
    for (unsigned k = 0; k < {len(values)}; k++) printf("%u\\n", splatcore_number(values[k]));
    return 0;
}}
"""
    got = [code for (code,) in run(config, tmp_path, "numbers", main)]
    assert got == format.encode(values).tolist()
