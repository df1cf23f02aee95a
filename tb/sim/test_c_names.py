"""Register names are usable as C and C++ identifiers; the C driver links into a C++ host."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from splatcore.sim.eda.register_files import DRIVER, FILES, fields, write_register_files
from splatcore.spec.config import TINY
from splatcore.spec.registers import ErrorCode, register_map
from tb.helpers.configs import MAPS

HEADERS = "stdint limits errno stdio stdlib math stddef stdbool string inttypes signal float"
LANGUAGES = {"c": ["gcc", "-std=gnu17"], "c++": ["g++", "-std=gnu++20"]}

needs_cpp = pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
LANGUAGE = [pytest.param("c"), pytest.param("c++", marks=needs_cpp)]


def names(config) -> set[str]:
    """Names of registers, of their fields and of error codes."""
    registers = register_map(config).values()
    inside = {field.name for register in registers for field in fields(register)}
    return {register.name for register in registers} | inside | {code.name for code in ErrorCode}


@pytest.mark.parametrize("language", LANGUAGE)
@pytest.mark.parametrize("config", MAPS, ids=lambda config: config.name)
def test_names_are_no_macros(language, config):
    """No standard header defines a macro of that name: PeakRDL uses them as struct members."""
    include = "".join(f"#include <{name}.h>\n" for name in HEADERS.split())
    command = [*LANGUAGES[language], "-x", language, "-E", "-dM", "-"]
    done = subprocess.run(command, input=include, capture_output=True, text=True, check=True)
    macros = set(re.findall(r"^#define (\w+)", done.stdout, re.M))
    assert {"SIZE_MAX", "INT_MAX", "EOF", "ERANGE", "RAND_MAX", "HUGE_VAL"} <= macros
    assert not names(config) & macros


@pytest.mark.parametrize("language", LANGUAGE)
@pytest.mark.parametrize("config", MAPS, ids=lambda config: config.name)
def test_names_are_no_keywords(language, config):
    """Nor in lower case, which generators may use."""
    known = names(config)
    found = sorted(known | {name.lower() for name in known})
    check = [*LANGUAGES[language], "-x", language, "-fsyntax-only", "-"]

    def compiles(members: list[str]) -> bool:
        text = "struct registers {" + "".join(f" int {name};" for name in members) + " };\n"
        return not subprocess.run(
            check, input=text, text=True, stderr=subprocess.DEVNULL
        ).returncode

    assert compiles(found) and not compiles([*found, "default"])


HOST = """\
#include "splatcore_camera.h"
extern "C" {
void splatcore_write(void *device, uint32_t address, uint32_t value)
{
    static_cast<volatile uint32_t *>(device)[address / 4] = value;
}
uint32_t splatcore_read(void *device, uint32_t address)
{
    return static_cast<volatile uint32_t *>(device)[address / 4];
}
void splatcore_pause(void *) {}
}
int main()
{
    static uint32_t registers[1024];
    static const uint8_t model[1024] = {};
    const double background[3] = {};
    splatcore_camera camera = {};
    splatcore_view view = {};
    camera.fx = camera.fy = camera.width = camera.height = 8;
    splatcore_look(&view, &camera, model, background);
    return splatcore_open(registers) == SPLATCORE_NO_DEVICE && view.width == 8 ? 0 : 1;
}
"""


@needs_cpp
@pytest.mark.parametrize("config", MAPS, ids=lambda config: config.name)
def test_a_host_in_cpp(tmp_path, config):
    """The driver is compiled as C, its host as C++; they link, and the host runs."""
    write_register_files(config, tmp_path)
    (tmp_path / "host.cc").write_text(HOST)
    strict = ["-Wall", "-Wextra", "-Werror", "-pedantic", f"-I{tmp_path}", "-c"]
    objects = []
    for source in ("splatcore_driver.c", "splatcore_camera.c", "host.cc"):
        standard = ["g++", "-std=c++11"] if source.endswith("cc") else ["gcc", "-std=c99"]
        objects.append(tmp_path / f"{source}.o")
        command = [*standard, *strict, tmp_path / source, "-o", objects[-1]]
        subprocess.run(command, check=True)
    subprocess.run(["g++", *objects, "-lm", "-o", tmp_path / "host"], check=True)
    subprocess.run([tmp_path / "host"], check=True)


def test_every_header_is_guarded(tmp_path):
    write_register_files(TINY, tmp_path)
    headers = [Path(name) for name in (*FILES, *DRIVER) if name.endswith(".h")]
    assert len(headers) == 3
    for header in headers:
        text = (tmp_path / header).read_text()
        assert text.count('#ifdef __cplusplus\nextern "C" {\n#endif\n') == 1, header
        assert text.endswith("#ifdef __cplusplus\n}\n#endif\n\n#endif\n"), header
        assert text.rindex("#include") < text.index('extern "C"'), header
