"""The register page, the C header, and SystemRDL as an independent compiler reads it, against
`spec.registers`. Names in the C headers and driver: usable in C, C++ and SystemVerilog, and
different for two machines."""

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from peakrdl_cheader.exporter import CHeaderExporter
from peakrdl_ipxact import IPXACTExporter
from peakrdl_regblock import RegblockExporter
from peakrdl_regblock.cpuif.passthrough import PassthroughCpuif
from peakrdl_regblock.udps import ALL_UDPS
from systemrdl import RDLCompiler
from systemrdl.messages import MessagePrinter
from systemrdl.node import AddrmapNode
from systemrdl.rdltypes import OnWriteType

from splatcore.eda.deliver.names import KEYWORDS
from splatcore.eda.deliver.register_files import DRIVER, FILES, fields, sizes, write_register_files
from splatcore.spec import registers
from splatcore.spec.axi import RENDERING
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.registers import READY, START, ErrorCode, register_map
from tb.helpers.c_host import STRICT, compile_c, host_lines
from tb.helpers.command import ROOT
from tb.helpers.configs import MAPS, wide_addresses
from tb.helpers.front_ends import slang

HEADERS = "stdint limits errno stdio stdlib math stddef stdbool string inttypes signal float"
LANGUAGES = {"c": ["gcc", "-std=gnu17"], "c++": ["g++", "-std=gnu++20"]}

needs_cpp = pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
in_both_languages = pytest.mark.parametrize("language", ["c", pytest.param("c++", marks=needs_cpp)])
of_all_machines = pytest.mark.parametrize("config", MAPS, ids=lambda config: config.name)

READ, WRITTEN = ("read", "write", "frame", "clear"), ("write", "frame", "clear", "control")


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


class Strict(MessagePrinter):
    """Raise on warnings, too."""

    def print_message(self, severity, text, source):
        raise AssertionError(f"{severity.name}: {text}")


def compiled(path: Path, *properties: type) -> AddrmapNode:
    """A register map as the compiler reads it. properties: further ones that an exporter knows."""
    compiler = RDLCompiler(message_printer=Strict())
    for each in properties:
        compiler.register_udp(each)
    compiler.compile_file(str(path))
    return compiler.elaborate().top


@pytest.fixture
def described(files):
    """A machine, and its register map as the compiler reads it."""
    return files[0], compiled(files[1] / "splatcore.rdl")


def test_registers(described):
    """Each register has the right name, address, width, access and reset value."""
    config, top = described
    given, found = register_map(config), {node.absolute_address: node for node in top.registers()}
    assert list(found) == list(given)
    for address, register in given.items():
        node = found[address]
        inside = list(node.fields())
        assert node.inst_name == register.name and node.size == 4
        assert node.get_property("desc").startswith(register.about)
        assert sum(field.width for field in inside) == register.width == inside[-1].high + 1
        for field in inside:
            assert field.is_sw_readable == (register.access in READ)
            assert field.is_sw_writable == (register.access in WRITTEN)
            kind = field.get_property("onwrite")
            clears = OnWriteType.wclr if register.name == "ERROR" else OnWriteType.woclr
            assert kind == (clears if register.access == "clear" else None)
            assert field.get_property("singlepulse") == (register.access == "control")
        resets = [field.get_property("reset") for field in inside]
        if register.reset is None:
            assert set(resets) == {None}
        else:
            value = sum(reset << field.low for reset, field in zip(resets, inside, strict=True))
            assert value == register.reset


def test_fields(described):
    """Fields have the names used by header and page; error codes are listed."""
    config, top = described
    for register in register_map(config).values():
        inside = list(top.get_child_by_name(register.name).fields())
        assert [(f.inst_name, f.low, f.width) for f in inside] == [
            (f.name, f.low, f.width) for f in fields(register)
        ]
    names = {name: top.get_child_by_name(name).fields() for name in ("STATUS", "INTERRUPT_ENABLE")}
    assert [f.inst_name for f in names["STATUS"]] == ["READY", "PREPROCESSING", "RENDERING"]
    assert [f.inst_name for f in names["INTERRUPT_ENABLE"]] == ["READY", "FRAME", "ERROR"]
    codes = top.get_child_by_name("ERROR").get_child_by_name("CODE").get_property("encode")
    assert {code.name: int(code) for code in codes} == {code.name: int(code) for code in ErrorCode}


def test_ip_xact(tiny_files, tmp_path):
    """PeakRDL's IP-XACT export has all registers at their addresses."""
    IPXACTExporter().export(compiled(tiny_files / "splatcore.rdl"), str(tmp_path / "splatcore.xml"))
    tree = ElementTree.parse(tmp_path / "splatcore.xml")
    found = {}
    for node in tree.iter():
        if node.tag.endswith("}register"):
            inside = {child.tag.partition("}")[2]: child.text for child in node}
            found[inside["name"]] = int(inside["addressOffset"].replace("'h", "0x"), 0)
    assert found == {register.name: at for at, register in register_map(TINY).items()}


@pytest.mark.parametrize("standard", ["c11", pytest.param("c++17", marks=needs_cpp)])
def test_c_header_of_peakrdl(described, standard, tmp_path):
    """PeakRDL's C header compiles after all standard headers, with every warning on."""
    CHeaderExporter().export(described[1], str(tmp_path / "peakrdl.h"))
    text = "".join(f"#include <{name}.h>\n" for name in HEADERS.split()) + '#include "peakrdl.h"\n'
    compiler = {"c11": ["gcc", "-x", "c"], "c++17": ["g++", "-x", "c++"]}[standard]
    command = [*compiler, f"-std={standard}", *STRICT, "-fsyntax-only", f"-I{tmp_path}", "-"]
    subprocess.run(command, input=text, text=True, check=True)


@pytest.mark.slow
def test_register_block_of_peakrdl(tiny_files, tmp_path):
    """PeakRDL makes registers in SystemVerilog that are legal."""
    node = compiled(tiny_files / "splatcore.rdl", *ALL_UDPS)
    RegblockExporter().export(node, str(tmp_path), cpuif_cls=PassthroughCpuif)
    assert not slang("splatcore", *sorted(tmp_path.iterdir(), reverse=True))


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
    assert not {name.lower() for name in names(config)} & KEYWORDS  # of SystemVerilog


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
    assert host_lines(files[1], host, ".cc") == ["1 8", "1"]


@pytest.mark.parametrize("standard", ["c99", "c11", "c17", "c++11", "c++17", "c++20"])
def test_standards(standard, tiny_files, tmp_path):
    """The driver, as C, and a host, as C++, compile without a warning in each standard."""
    of_host = ROOT / "tb/eda/host.cc"
    for source in [of_host] if "++" in standard else sorted(tiny_files.glob("*.c")):
        compile_c(tiny_files, source, f"-std={standard}", "-c", "-o", tmp_path / "made.o")


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
