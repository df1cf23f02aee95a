"""What the page says beside the picture, as Markdown."""

import re
from collections.abc import Iterable

from splatcore.sim.common.metric import decibels
from splatcore.sim.cycles.frame import STAGES

UNCOMPENSATED = "Antialiased ({}): the browser's own picture is drawn without opacity compensation."
"""The page's line on a marked scene, with the mark."""


def noted(notes: Iterable[str]) -> str:
    """Notes on the scene, a line each; their letters are no markup."""
    lines = (re.sub(r"([\\`*_{}\[\]<>#|])", r"\\\1", note) for note in notes)
    return "\n".join(f"- {line}" for line in lines)


def told(facts: dict) -> str:
    """Numbers of a view: as far as they are known."""
    if "cycles" not in facts:
        return ""
    cycles, (width, height) = facts["cycles"], facts["size"]
    packed = f", {facts['quality']}" if facts["quality"] else ""
    lines = [f"**{facts['layer']}**, {facts['preset']}{packed}, {width}×{height}"]
    lines += [facts["scale"]] if "scale" in facts else []
    rows = {"cycles": f"{cycles['frame']:,}", "frames a second": f"{cycles['fps']:,.1f}"}
    for name, against in (("machine", "the model"), ("scene", "the scene")):
        if f"max_error_{name}" in facts:
            rows[f"dB {name} (against {against})"] = decibels(facts, name)
    lines += ["", *table(("at 800 MHz", ""), rows)]
    lines += ["", f"Binds: **{cycles['stage']}** in {cycles['half']}", ""]
    stages = {}
    for half, names in STAGES.items():
        stages[f"**{half}**"] = f"**{cycles[half]:,}**"
        stages |= {name: f"{cycles[name]:,}" for name in names}
    return "\n".join(lines + table(("stage", "cycles"), stages))


def told_rtl(facts: dict) -> str:
    """What came of a simulation."""
    if "rtl_cycles" not in facts:
        return f"RTL: {facts['rtl']}"
    return f"RTL: {facts['rtl']}; {facts['rtl_cycles']:,} cycles, the slower half alone"


def table(head: tuple[str, str], rows: dict[str, str]) -> list[str]:
    """A table of names and numbers."""
    return [f"| {head[0]} | {head[1]} |", "|:--|--:|", *(f"| {k} | {v} |" for k, v in rows.items())]
