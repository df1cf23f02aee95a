#!/bin/bash
# The SPZ library exchanges RFD with RBU, and LFD with LBU.
#
# @adobe/spz 0.2.3, a build of the format's own library. A name of axes says where x, y and z point: RFD is right, forward,
# down. Of 16 systems 12 are converted as their letters say. Seen on 2026-11-28: (1, 2, 3) in RFD, asked for in RUB,
# comes back as (1, 3, 2), which is right for RBU; it should be (1, −3, −2). RBU, LFD and LBU are exchanged likewise.
# It matters to those who write or read scenes with z up or down by that library: the scene stands on its head.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-fund --no-audit @adobe/spz@0.2.3

cat > turn.mjs <<'JS'
import create from "@adobe/spz";

const spz = await create({ print: () => {} });
const axes = { R: [0, 1], L: [0, -1], U: [1, 1], D: [1, -1], B: [2, 1], F: [2, -1] }; // in RUB: axis, sign
const floats = (...values) => new Float32Array(values);
const other = [];
for (const name of Object.keys(spz.CoordinateSystem).filter((key) => /^[LR][UDFB][UDFB]$/.test(key))) {
  const cloud = {
    numPoints: 1, shDegree: 0, antialiased: false, extensions: [], positions: floats(1, 2, 3), scales: floats(-3, -3, -3),
    rotations: floats(0, 0, 0, 1), alphas: floats(0), colors: floats(0, 0, 0), sh: floats(),
  };
  const options = { version: 3, from: spz.CoordinateSystem[name], sh1Bits: 5, shRestBits: 4 };
  const file = spz.saveSpzToBuffer(cloud, options);
  const found = Array.from(spz.loadSpzFromBuffer(file, { to: spz.CoordinateSystem.RUB }).positions);
  const right = [0, 0, 0];
  [1, 2, 3].forEach((value, place) => { right[axes[name[place]][0]] = axes[name[place]][1] * value; });
  if (found.join() !== right.join()) {
    other.push(name);
    console.log(`${name}: ${found} instead of ${right}`);
  }
}
if (other.sort().join() !== "LBU,LFD,RBU,RFD") process.exit(1);
JS
node turn.mjs && echo "as described"
