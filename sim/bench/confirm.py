"""Results of a campaign's models, confirmed in RTL simulation."""

from pathlib import Path

from splatcore.sim.bench.scenes import Simulator
from splatcore.sim.common.scenes import View
from splatcore.sim.machine.script import LPDDR4
from splatcore.spec.config import Config
from splatcore.spec.error import InputError


def in_rtl(config: Config, view: View, folder: Path, name: str) -> dict:
    """Cycles of a view's frame in RTL and by the cycle model, and if RTL equals the golden model.

    Kept in the folder until the machine's Verilog is another. InputError if it cannot be simulated.
    """
    title = f"rtl {name} {view.name} {view.size}.json".replace(":", "-").replace("/", "-")
    row = Simulator(config).row(view, LPDDR4, folder / title)
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
    """The same; what cannot be simulated (None) or is wrong is added to `failed`."""
    what = f"rtl {name} {view.name}"
    try:
        row = in_rtl(config, view, folder, name)
    except InputError as error:
        failed.append({"what": what, "why": str(error)})
        return None
    if not row["identical"]:
        failed.append({"what": what, "why": "the picture is not the golden model's"})
    return row
