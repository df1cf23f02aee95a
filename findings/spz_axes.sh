#!/bin/bash
# SPZ files by two converters hold the axes of the PLY; the format's own library reads them upside down.
#
# @playcanvas/splat-transform 3.7.0 and gsply 0.4.6 to write; @adobe/spz 0.2.3, a build of the format's own library, to
# read. By its specification an SPZ that states no axes is RUB (y up, z back), a trained PLY is RDF (y down, z forward).
# Both converters store the PLY's numbers as they are. Seen on 2026-11-28: a point (1, 2, 3) of the PLY comes back
# from the library, asked for RDF, as (1, −2, −3), and as (1, 2, 3) from gsply.
# It matters because both readings are right for some files: without a record in the file a reader has to ask.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv env; env/bin/pip install -q gsply==0.4.6 numpy==2.4.6
npm install --silent --no-fund --no-audit @playcanvas/splat-transform@3.7.0 @adobe/spz@0.2.3

env/bin/python - <<'PY'
import gsply
import numpy as np

names = [*"xyz", *(f"f_dc_{i}" for i in range(3)), "opacity"]
names += [*(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
point = np.array([1, 2, 3, 0, 0, 0, 0, -3, -3, -3, 1, 0, 0, 0], "<f4")
lines = ["ply", "format binary_little_endian 1.0", "element vertex 1"]
lines += [f"property float {name}" for name in names] + ["end_header", ""]
open("in.ply", "wb").write("\n".join(lines).encode() + point.tobytes())
gsply.write_spz("gsply.spz", gsply.plyread("in.ply"))
print("gsply reads its own file as", gsply.read_spz("gsply.spz").means.tolist())
PY
node_modules/.bin/splat-transform -w in.ply splat-transform.spz > /dev/null 2>&1
cat > read.mjs <<'JS'
import create from "@adobe/spz";
import fs from "fs";

const spz = await create({ print: () => {} });
let wrong = 0;
for (const name of ["gsply.spz", "splat-transform.spz"]) {
  const cloud = spz.loadSpzFromBuffer(new Uint8Array(fs.readFileSync(name)), { to: spz.CoordinateSystem.RDF });
  console.log(`${name}, asked for RDF: ${Array.from(cloud.positions)}`);
  wrong += Array.from(cloud.positions).join() === "1,-2,-3";
}
if (wrong !== 2) process.exit(1);
JS
node read.mjs && echo "as described"
