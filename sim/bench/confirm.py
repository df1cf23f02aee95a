"""What a campaign has found by models, confirmed in RTL simulation."""

import json
from pathlib import Path

from splatcore.sim.bench.scenes import expect, finished, key_of, measure
from splatcore.sim.common.output import write
from splatcore.sim.common.scenes import View
from splatcore.sim.machine.machine import machine_source
from splatcore.sim.machine.path import build
from splatcore.sim.machine.script import LPDDR4
from splatcore.spec.config import Config
from splatcore.spec.error import InputError


def in_rtl(config: Config, view: View, folder: Path, name: str) -> dict:
    """Cycles of a view's frame in RTL and by the cycle model, and whether RTL equals the twin.

    Kept in the folder until the machine's Verilog is another. InputError if it cannot be simulated.
    """
    source = machine_source(config)
    key = key_of(source, config, view, LPDDR4)
    path = folder / f"rtl {name} {view.name} {view.size}.json".replace(":", "-").replace("/", "-")
    row = finished(path, key)
    if row is None:
        machine = build(config, source=source)
        row = {"key": key} | measure(machine, view, expect(config, view), LPDDR4)
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, (json.dumps(row, indent=2) + "\n").encode())
    if "cycles" not in row:
        raise InputError(f"{config.name}: {row['ended']}")
    return {
        "scene": row["scene"], "camera": row["camera"], "size": row["size"],
        "cycles": row["cycles"]["frame"], "model_cycles": row["model_cycles"]["frame"],
        "identical": row["identical"],
    }  # fmt: skip


def confirmed(
    config: Config, view: View, folder: Path, name: str, failed: list[dict[str, str]]
) -> dict | None:
    """The same; what cannot be simulated (None) or is not the twin's is added to `failed`."""
    what = f"rtl {name} {view.name}"
    try:
        row = in_rtl(config, view, folder, name)
    except InputError as error:
        failed.append({"what": what, "why": str(error)})
        return None
    if not row["identical"]:
        failed.append({"what": what, "why": "the picture is not the golden model's"})
    return row
