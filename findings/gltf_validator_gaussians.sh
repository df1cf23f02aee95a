#!/bin/bash
# The glTF validator calls every attribute of KHR_gaussian_splatting invalid, so its errors say nothing about such a file.
#
# gltf-validator 2.0.0-dev.3.10 (npm). The extension names attributes `KHR_gaussian_splatting:ROTATION`, `:SCALE`, `:OPACITY`,
# `:SH_DEGREE_0_COEF_0`. Seen on 2026-11-29 on a file of one Gaussian: an error MESH_PRIMITIVE_INVALID_ATTRIBUTE for each of the
# four, and the extension is listed as unsupported; the same file without them and without the extension has no error.
# It matters because a pipeline that stops at the validator's errors refuses all splats, and one that ignores this code
# also ignores it for misspelt attributes: count the errors of this code, and compare with the number of attributes.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-fund --no-audit gltf-validator@2.0.0-dev.3.10

cat > check.js <<'JS'
const { validateBytes, version } = require("gltf-validator");
const NAME = "KHR_gaussian_splatting";
const OWN = { ROTATION: [0, 0, 0, 1], SCALE: [1, 1, 1], OPACITY: [0.5], SH_DEGREE_0_COEF_0: [0, 0, 0] };
const TYPES = { 1: "SCALAR", 3: "VEC3", 4: "VEC4" };

function file(gaussians) {
  const numbers = [0, 0, 0], attributes = { POSITION: 0 };
  const accessors = [{ type: "VEC3", min: [0, 0, 0], max: [0, 0, 0] }], bufferViews = [{ byteOffset: 0, byteLength: 12 }];
  for (const [name, values] of Object.entries(gaussians ? OWN : {})) {
    attributes[`${NAME}:${name}`] = accessors.length;
    accessors.push({ type: TYPES[values.length] });
    bufferViews.push({ byteOffset: 4 * numbers.length, byteLength: 4 * values.length });
    numbers.push(...values);
  }
  accessors.forEach((one, k) => Object.assign(one, { bufferView: k, componentType: 5126, count: 1 }));
  const data = Buffer.from(new Float32Array(numbers).buffer);
  const about = { kernel: "ellipse", colorSpace: "srgb_rec709_display" };
  const primitive = { mode: 0, attributes, ...(gaussians && { extensions: { [NAME]: about } }) };
  return Buffer.from(JSON.stringify({
    asset: { version: "2.0" }, scene: 0, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [primitive] }], accessors, ...(gaussians && { extensionsUsed: [NAME] }),
    buffers: [{ byteLength: data.length, uri: "data:application/octet-stream;base64," + data.toString("base64") }],
    bufferViews: bufferViews.map((view) => ({ buffer: 0, ...view })),
  }));
}

(async () => {
  const counts = [];
  for (const gaussians of [false, true]) {
    const { issues } = await validateBytes(new Uint8Array(file(gaussians)));
    const errors = issues.messages.filter((message) => message.severity === 0);
    counts.push(errors.length);
    console.log(gaussians ? "with Gaussians:" : "without:", errors.map((e) => `${e.code} ${e.pointer}`));
    if (errors.some((e) => e.code !== "MESH_PRIMITIVE_INVALID_ATTRIBUTE")) process.exit(1);
    if (gaussians && !issues.messages.some((m) => m.code === "UNSUPPORTED_EXTENSION")) process.exit(1);
  }
  if (counts[0] !== 0 || counts[1] !== Object.keys(OWN).length) process.exit(1);
  console.log("version", version(), "as described");
})();
JS
node check.js
