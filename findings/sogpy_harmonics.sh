#!/bin/bash
# sogpy writes SOG files that open everywhere, with harmonics of other channels.
#
# sogpy 1.0.2; @playcanvas/splat-transform 3.7.0, of the format's makers, to read. A SOG file keeps harmonics in a palette
# whose pixels hold red, green and blue of one coefficient. A PLY keeps 15 coefficients of red, then of green, then of blue;
# sogpy takes them from there three in a row. Seen on 2026-11-28, 2,048 Gaussians of degree 3: positions, constant colour
# and opacity are right; of the 45 columns the first and the last are right, the others are mixed.
# It matters because nothing complains: such a file looks right from some directions only, and no reader can mend it.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q sogpy==1.0.2 numpy==2.4.6 scipy==1.17.1
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
PY
env/bin/sogpy in.ply out.sog > /dev/null
node_modules/.bin/splat-transform -g cpu -w out.sog back.ply > /dev/null 2>&1
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

old, new = read("in.ply"), read("back.ply")
place = [np.stack([each[axis] for axis in "xyz"], 1) for each in (old, new)]
nearest = cKDTree(place[0]).query(place[1])[1]  # the file has another order
assert len(set(nearest)) == len(nearest) == 2048


def agree(column, other=None):
    return np.corrcoef(old[other or column][nearest], new[column])[0, 1] > 0.99


right = [k for k in range(45) if agree(f"f_rest_{k}")]
mixed = [k for k in range(45) if agree(f"f_rest_{k % 3 * 15 + k // 3}", f"f_rest_{k}")]
print("constant colour right:", agree("f_dc_0") and agree("f_dc_1") and agree("f_dc_2"))
print("columns of 45 that are right:", right)
print("columns k found at k % 3 * 15 + k // 3:", len(mixed))
assert agree("f_dc_0") and agree("opacity") and len(right) < 5 and len(mixed) == 45
print("as described")
PY
