"""Names in the C headers and driver: usable in C and C++, and different for two machines."""

import re
import shutil
import subprocess

import pytest

from splatcore.eda.deliver.register_files import DRIVER, FILES, fields, write_register_files
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.registers import ErrorCode, register_map
from tb.helpers.c_host import host_lines
from tb.helpers.command import ROOT
from tb.helpers.configs import MAPS, wide_addresses

HEADERS = "stdint limits errno stdio stdlib math stddef stdbool string inttypes signal float"
LANGUAGES = {"c": ["gcc", "-std=gnu17"], "c++": ["g++", "-std=gnu++20"]}

needs_cpp = pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
in_both_languages = pytest.mark.parametrize("language", ["c", pytest.param("c++", marks=needs_cpp)])
of_all_machines = pytest.mark.parametrize("config", MAPS, ids=lambda config: config.name)


def names(config) -> set[str]:
    """Names of registers, of their fields and of error codes."""
    registers = register_map(config).values()
    inside = {field.name for register in registers for field in fields(register)}
    return {register.name for register in registers} | inside | {code.name for code in ErrorCode}


@in_both_languages
@of_all_machines
def test_names_are_no_macros(language, config):
    """No standard header defines a macro of that name: PeakRDL uses them as struct members."""
    include = "".join(f"#include <{name}.h>\n" for name in HEADERS.split())
    command = [*LANGUAGES[language], "-x", language, "-E", "-dM", "-"]
    done = subprocess.run(command, input=include, capture_output=True, text=True, check=True)
    macros = set(re.findall(r"^#define (\w+)", done.stdout, re.M))
    assert {"SIZE_MAX", "INT_MAX", "EOF", "ERANGE", "RAND_MAX", "HUGE_VAL"} <= macros
    assert not names(config) & macros


@in_both_languages
@of_all_machines
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


@needs_cpp
def test_a_host_in_cpp(files):
    """The driver is compiled as C, its host as C++; they link, and the host runs."""
    host = (ROOT / "tb/eda/host.cc").read_text()
    assert host_lines(files[1], host, ".cc") == ["1 8"]


def test_every_header_is_guarded(tiny_files):
    headers = [tiny_files / name for name in (*FILES, *DRIVER) if name.endswith(".h")]
    assert len(headers) == 3
    for header in headers:
        text = header.read_text()
        assert text.count('#ifdef __cplusplus\nextern "C" {\n#endif\n') == 1, header
        assert text.endswith("#ifdef __cplusplus\n}\n#endif\n\n#endif\n"), header
        assert text.rindex("#include") < text.index('extern "C"'), header


def test_headers_and_drivers_of_two_machines(tmp_path):
    """One C program includes and links both; every name has its machine's prefix."""
    machines = {"left": TINY, "RIGHT": wide_addresses(DEFAULT)}
    for prefix, config in machines.items():
        write_register_files(config, tmp_path, prefix)
    written = [path for path in tmp_path.iterdir() if path.suffix in (".c", ".h", ".rdl")]
    assert not re.search(r"\bsplatcore_|SPLATCORE_", "".join(p.read_text() for p in written))
    assert {re.split(r"[_.]", path.name)[0] for path in written} == set(machines)
    host = (ROOT / "tb/eda/two_machines.c").read_text()
    assert host_lines(tmp_path, host) == ["64 1920", "4 8", "-1 -1"]
