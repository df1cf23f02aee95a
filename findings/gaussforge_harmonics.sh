#!/bin/bash
# gaussforge writes compressed PLY with harmonics in another order than the format has.
#
# gaussforge 0.6.0; @playcanvas/splat-transform 3.7.0, of the format's makers, to read. The columns f_rest_0 to 44 of the
# element `sh` go channel by channel, as in a PLY; gaussforge writes and reads them coefficient by coefficient. Seen on
# 2026-11-28, 2,048 Gaussians of degree 3: 42 of 45 columns are another's. SPZ and SOG from the same library are right.
# It matters because a round trip within the library shows nothing, and the file opens everywhere without a complaint:
# compare files of two writers.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q gaussforge==0.6.0 numpy==2.4.6 scipy==1.17.1
npm install --silent --no-fund --no-audit @playcanvas/splat-transform@3.7.0

env/bin/python - <<'PY'
import numpy as np
rng, n = np.random.default_rng(1), 2048
names = ["x", "y", "z", *(f"f_dc_{i}" for i in range(3)), *(f"f_rest_{i}" for i in range(45))]
names += ["opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
a = np.zeros((n, len(names)), "<f4")
a[:, :3] = rng.uniform(-1, 1, (n, 3))
a[:, 3:6] = rng.uniform(-1, 1, (n, 3))
a[:, 6:51] = rng.uniform(-0.3, 0.3, (32, 45))[np.arange(n) % 32]  # few, so that palettes are exact
a[:, 51:55] = rng.uniform(-5, -2, (n, 4))
a[:, 55] = 1
header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
header += [f"property float {name}" for name in names] + ["end_header", ""]
open("in.ply", "wb").write("\n".join(header).encode() + a.tobytes())

import gaussforge

data = open("in.ply", "rb").read()
for name in ("compressed.ply", "spz", "sog"):
    written = gaussforge.GaussForge().convert(data, "ply", name)["data"]
    open(f"out.{name}", "wb").write(bytes(written))
PY
for name in compressed.ply spz sog; do
  node_modules/.bin/splat-transform -g cpu -w out.$name ${name%.ply}.back.ply > /dev/null 2>&1
done
env/bin/python - <<'PY'
import numpy as np
from scipy.spatial import cKDTree

def read(path):
    data = open(path, "rb").read()
    start = data.index(b"end_header\n") + 11
    lines = data[:start].decode().split("\n")
    names = [line.split()[2] for line in lines if line.startswith("property float")]
    count = int(next(line for line in lines if line.startswith("element vertex")).split()[2])
    return dict(zip(names, np.frombuffer(data, "<f4", count * len(names), start).reshape(count, -1).T))

COLUMNS = [f"f_rest_{k}" for k in range(45)]
old, wrong = read("in.ply"), {}
for name in ("compressed", "spz", "sog"):
    new = read(f"{name}.back.ply")
    place = [np.stack([each[axis] for axis in "xyz"], 1) for each in (old, new)]
    nearest = cKDTree(place[0]).query(place[1])[1]  # some formats have another order
    agree = [np.corrcoef(old[c][nearest], new[c])[0, 1] > 0.9 for c in COLUMNS]
    wrong[name] = [k for k, right in enumerate(agree) if not right]
    print(f"{name}: {len(wrong[name])} of 45 columns wrong")
assert len(wrong["compressed"]) == 42 and not wrong["spz"] and not wrong["sog"]
print("as described")
PY
