"""The register page and C header, against `spec.registers`; two machines in one C program."""

import re
import subprocess
from pathlib import Path

import pytest

from splatcore.sim.eda.register_files import DRIVER, FILES, sizes, write_register_files
from splatcore.spec import registers
from splatcore.spec.axi import RENDERING
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.registers import READY, START, ErrorCode, register_map
from tb.helpers.configs import MAPS, wide_addresses


@pytest.fixture(params=MAPS, ids=lambda config: config.name)
def files(request, tmp_path):
    """A machine, and the folder with its generated files."""
    paths = write_register_files(request.param, tmp_path)
    assert [path.name for path in paths] == [*FILES, *DRIVER]
    return request.param, tmp_path


def defines(folder: Path) -> dict[str, int]:
    """Integer macros of the header by name, from the C preprocessor."""
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


TWO = """\
#include <stdio.h>
#include "left_camera.h"
#include "RIGHT_camera.h"
void left_write(void *device, uint32_t address, uint32_t value)
{
    (void)device, (void)address, (void)value;
}
uint32_t left_read(void *device, uint32_t address) { (void)device; return address; }
void left_pause(void *device) { (void)device; }
void RIGHT_write(void *device, uint32_t address, uint32_t value)
{
    (void)device, (void)address, (void)value;
}
uint32_t RIGHT_read(void *device, uint32_t address) { (void)device; return address; }
void RIGHT_pause(void *device) { (void)device; }
int main(void)
{
    struct left_memory left = {0};
    struct RIGHT_memory right = {0};
    printf("%d %d\\n", LEFT_WIDTH_MAX, RIGHT_WIDTH_MAX);
    printf("%d %d\\n", (int)sizeof left.model, (int)sizeof right.model);
    printf("%d %d\\n", (int)left_open(0), (int)RIGHT_open(0));
    return 0;
}
"""


def test_headers_and_drivers_of_two_machines(tmp_path):
    """One C program includes and links both; every name has its machine's prefix."""
    machines = {"left": TINY, "RIGHT": wide_addresses(DEFAULT)}
    paths = [
        path
        for prefix, config in machines.items()
        for path in write_register_files(config, tmp_path, prefix)
    ]
    left = [path for path in paths if path.suffix in (".c", ".h", ".rdl")]
    assert not re.search(r"\bsplatcore_|SPLATCORE_", "".join(p.read_text() for p in left))
    assert {path.name.split("_")[0].split(".")[0] for path in left} == set(machines)
    (tmp_path / "two.c").write_text(TWO)
    sources = [tmp_path / "two.c", *(path for path in left if path.suffix == ".c")]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", f"-I{tmp_path}"]
    program = tmp_path / "two"
    subprocess.run(["gcc", *flags, *sources, "-lm", "-o", program], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["64 1920", "4 8", "-1 -1"]
