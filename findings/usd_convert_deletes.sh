#!/bin/bash
# Writing `scene.usdz` deletes a `scene.usda` that was there before.
#
# usd-convert-gsplat 0.1.15. For a USDZ it writes a USDA of the same name into the same folder, packs it and deletes it;
# a file of that name that the user had is overwritten and gone. Seen on 2026-11-28: no question, no message, status 0.
# It matters because a conversion to the second format of one scene loses the first.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q usd-convert-gsplat==0.1.15 usd-core==26.11

env/bin/python - <<'PY'
import numpy as np

names = [*"xyz", *(f"f_dc_{i}" for i in range(3)), "opacity"]
names += [*(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
rows = np.zeros((8, len(names)), "<f4")
rows[:, :3], rows[:, 10] = np.random.default_rng(1).uniform(-1, 1, (8, 3)), 1
lines = ["ply", "format binary_little_endian 1.0", "element vertex 8"]
lines += [f"property float {name}" for name in names] + ["end_header", ""]
open("in.ply", "wb").write("\n".join(lines).encode() + rows.tobytes())
PY
env/bin/usd-convert-gsplat -i in.ply -o scene.usda > /dev/null
echo "before: $(echo scene.*)"
env/bin/usd-convert-gsplat -i in.ply -o scene.usdz > output
echo "after:  $(echo scene.*), lines that name scene.usda: $(grep -c 'scene\.usda' output || true)"
[ ! -e scene.usda ] && [ -e scene.usdz ] && echo "as described"
