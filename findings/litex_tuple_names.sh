#!/bin/bash
# LiteX names signals 0 and 1 if a script creates them in one line, and its Verilog takes them for numbers.
#
# litex 2024.12 with migen 0.10.0, Python 3.11. Names of signals are those of the Python variables that they are
# assigned to. `first, second = Signal(2), Signal(2)` in a script gives `reg [1:0] 0` and `reg [1:0] 1`, and
# `third.eq(second)` becomes `third <= 1`. Seen on 2026-11-29: no error and no warning by LiteX; yosys refuses the
# declaration. Two lines instead of one give the right names. Within a module's __init__ the first signal of such a line
# is called as the module.
# It matters as boards around the machine are made by LiteX scripts: there, one line per signal.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q litex==2024.12 migen==0.10.0

cat > one_line.py <<'PYTHON'
from litex.build.generic_platform import Pins
from litex.build.lattice import LatticePlatform
from migen import ClockDomain, Module, Signal

pins = [("led", 0, Pins("A1 A2")), ("clk", 0, Pins("A3"))]
platform = LatticePlatform("LFE5U-12F-6BG256C", pins, toolchain="trellis")
top = Module()
top.clock_domains.cd_sys = ClockDomain(reset_less=True)
first, second = Signal(2), Signal(2)
third = Signal(2)
top.comb += [top.cd_sys.clk.eq(platform.request("clk")), platform.request("led").eq(third)]
top.sync += [first.eq(first + 1), second.eq(second - first), third.eq(second)]
platform.finalize(top)
print(platform.get_verilog(top))
PYTHON
sed 's/^first, second = .*/first = Signal(2)\nsecond = Signal(2)/' one_line.py > two_lines.py

for script in one_line two_lines; do
  env/bin/python $script.py > $script.v
  echo "$script: $(grep -c '^reg' $script.v) registers: $(sed -n 's/^reg *\[1:0\] *\(.*\) = .*/\1/p' $script.v | tr '\n' ' ')"
done
grep -q 'third <= 1;' one_line.v && grep -q 'third <= second;' two_lines.v && echo "as described"
