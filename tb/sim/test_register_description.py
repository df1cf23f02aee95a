"""The register map in SystemRDL, read by an independent compiler, against `spec.registers`."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from peakrdl_ipxact import IPXACTExporter
from systemrdl import RDLCompiler
from systemrdl.messages import MessagePrinter
from systemrdl.node import AddrmapNode
from systemrdl.rdltypes import OnWriteType

from splatcore.sim.eda.register_files import fields, write_register_files
from splatcore.spec.config import TINY
from splatcore.spec.registers import ErrorCode, register_map
from tb.helpers.configs import MAPS

READ, WRITTEN = ("read", "write", "frame", "clear"), ("write", "frame", "clear", "control")


class Strict(MessagePrinter):
    """Raise on warnings, too."""

    def print_message(self, severity, text, source):
        raise AssertionError(f"{severity.name}: {text}")


def compiled(path: Path) -> AddrmapNode:
    compiler = RDLCompiler(message_printer=Strict())
    compiler.compile_file(str(path))
    return compiler.elaborate().top


@pytest.fixture(params=MAPS, ids=lambda config: config.name)
def machine(request, tmp_path):
    """A machine, and its register map as the compiler reads it."""
    write_register_files(request.param, tmp_path)
    return request.param, compiled(tmp_path / "splatcore.rdl")


def test_registers(machine):
    """Each register has the right name, address, width, access and reset value."""
    config, top = machine
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


def test_fields(machine):
    """Fields have the names used by header and page; error codes are listed."""
    config, top = machine
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


def test_ip_xact(tmp_path):
    """PeakRDL's IP-XACT export has all registers at their addresses."""
    write_register_files(TINY, tmp_path)
    IPXACTExporter().export(compiled(tmp_path / "splatcore.rdl"), str(tmp_path / "splatcore.xml"))
    tree = ElementTree.parse(tmp_path / "splatcore.xml")
    found = {}
    for node in tree.iter():
        if node.tag.endswith("}register"):
            inside = {child.tag.partition("}")[2]: child.text for child in node}
            found[inside["name"]] = int(inside["addressOffset"].replace("'h", "0x"), 0)
    assert found == {register.name: at for at, register in register_map(TINY).items()}
