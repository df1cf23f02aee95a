#!/bin/bash
# gsply reads an SPZ that is marked as antialiased and writes it without the mark.
#
# gsply 0.4.6. Bit 0 of the flags in an SPZ header says that the scene was trained with opacity compensation; without it a
# renderer draws other opacities. Seen on 2026-11-28: flags 1 read, flags 0 written, no warning.
# It matters because the loss shows as a picture that is too dense at small sizes, tens of dB, not as an error: after a
# conversion set the mark again, or state it on the command line.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q gsply==0.4.6

env/bin/python - <<'PY'
import gzip
import struct

import gsply

header = struct.pack("<4sIIBBBB", b"NGSP", 3, 2, 0, 12, 1, 0)  # version 3, 2 Gaussians, degree 0, marked
positions, alphas, colours = bytes(18), bytes([200, 200]), bytes([128] * 6)
scales, rotations = bytes([96] * 6), struct.pack("<II", 3 << 30, 3 << 30)
open("in.spz", "wb").write(gzip.compress(header + positions + alphas + colours + scales + rotations))

gsply.write_spz("out.spz", gsply.read_spz("in.spz"))
flags = [gzip.decompress(open(name, "rb").read())[14] for name in ("in.spz", "out.spz")]
print("flags read and written:", flags)
assert flags == [1, 0]
print("as described")
PY
