"""Texts of the page, next to the picture, as Markdown."""

import re
from collections.abc import Iterable

from splatcore.app.view.drawn import Drawn
from splatcore.sim.frame.metric import decibels
from splatcore.spec.stages import HALVES

UNCOMPENSATED = "Antialiased ({}): the browser's own picture is drawn without opacity compensation."
"""Line on an antialiased scene, with the reason."""


def noted(notes: Iterable[str]) -> str:
    """Return notes as a list in Markdown, with special characters escaped."""
    lines = (re.sub(r"([\\`*_{}\[\]<>#|])", r"\\\1", note) for note in notes)
    return "\n".join(f"- {line}" for line in lines)


def drawn_text(drawn: Drawn) -> str:
    """Return a line on the browser's picture: how many Gaussians it shows."""
    count, rest = f"{drawn.total:,}", ""
    if len(drawn) < drawn.total:
        count, rest = f"{len(drawn):,} of {count}", " (the largest and most opaque)"
    return f"*Browser's picture: base colours of {count} Gaussians{rest}*"


def facts_text(facts: dict) -> str:
    """Return the numbers of a view, as far as they are known."""
    if "size" not in facts:
        return ""
    width, height = facts["size"]
    packed = f", {facts['quality']}" if facts["quality"] else ""
    lines = [f"**{facts['layer']}**, {facts['preset']}{packed}, {width}×{height}"]
    if "cycles" not in facts:
        return lines[0]
    cycles = facts["cycles"]
    lines += [facts["scale"]] if "scale" in facts else []
    rows = {"cycles": f"{cycles['frame']:,}", "frames per second": f"{cycles['fps']:,.1f}"}
    for name, against in (("machine", "the model"), ("scene", "the scene")):
        if f"max_error_{name}" in facts:
            rows[f"dB {name} (against {against})"] = decibels(facts, name)
    lines += ["", *table(("at 800 MHz", ""), rows)]
    lines += ["", f"Bottleneck: **{cycles['stage']}** in {cycles['half']}", ""]
    stages = {}
    for half, names in HALVES.items():
        stages[f"**{half}**"] = f"**{cycles[half]:,}**"
        stages |= {name: f"{cycles[name]:,}" for name in names}
    return "\n".join(lines + table(("stage", "cycles"), stages))


def rtl_text(facts: dict) -> str:
    """Return the outcome of a simulation as text."""
    if "rtl_cycles" not in facts:
        return f"RTL: {facts['rtl']}"
    return f"RTL: {facts['rtl']}; {facts['rtl_cycles']:,} cycles (slower half)"


def table(head: tuple[str, str], rows: dict[str, str]) -> list[str]:
    """Return a table of names and numbers, as lines of Markdown."""
    return [f"| {head[0]} | {head[1]} |", "|:--|--:|", *(f"| {k} | {v} |" for k, v in rows.items())]
