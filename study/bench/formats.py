"""`splatcore bench formats`: comparison of other compressed formats with packed models.

PlayCanvas' splat-transform (npm) writes the other formats, and our readers read its files. PSNR is
between the reference's 8-bit pictures of the file and of the scene as trained.
"""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

from splatcore.model.compress.checkpoint import ply_bytes
from splatcore.model.formats.model_file import file_bytes, read_model
from splatcore.model.formats.ply import write_ply
from splatcore.model.pack.pack import pack
from splatcore.model.pack.quality import UNLEARNED
from splatcore.sim.frame.choose import SAME_DB, Views
from splatcore.sim.frame.source import View, open_source
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians
from splatcore.study.bench.campaign import Task, collected

TOOL, PACKAGE = "splat-transform", "@playcanvas/splat-transform"

OTHERS = {"SOG": ".sog", "compressed PLY": ".compressed.ply", "SPZ": ".spz"}
"""File suffix of each format; the tool recognises formats by it."""

TURNED = ("--rotate", "180,0,0")
"""Action that turns a PLY's axes into SPZ's (y up, z back); version 3.7 does not do so itself."""


def find_tool(tool: str | None) -> str:
    """Find the tool's path; raise InputError if it is not installed."""
    found = shutil.which(tool or TOOL)
    if found is None:
        missing = f"{tool or TOOL}: no such program"
        raise InputError(f"{missing}; npm install -g {PACKAGE}, or set its path by --tool")
    return found


def formats(
    config: Config, views: list[View], tool: str, compressed: list[str], folder: Path,
    scheduler: str | None,
) -> dict:  # fmt: skip
    """Measure all views; reuse existing results.

    tool: path from `find_tool`
    compressed: model files of `splatcore compress`; only with a single scene
    """
    models = [(path, Path(path).read_bytes()) for path in compressed]
    tasks = [
        Task(
            f"formats {view.name} {view.size}".replace("/", "-").replace(":", "-"),
            f"{view} {config!r} {version(tool)} {models}", measure,
            (config, view, tool, compressed, folder),
        )
        for view in views
    ]  # fmt: skip
    results, failed = collected(tasks, folder, scheduler, "formats")
    rows = [row for task in tasks for row in results.get(task.name, {}).get("rows", ())]
    facts = {"tool": version(tool), "preset": config.name, "size": views[0].size}
    return facts | {"rows": rows, "failed": failed}


def version(tool: str) -> str:
    """The tool's version."""
    return called(tool, "--version").strip()


def called(*words: str) -> str:
    """Run a program and return its output; raise InputError with its last line if it fails."""
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        says = (done.stderr or done.stdout).strip().splitlines() or ["no output"]
        raise InputError(f"{words[0]}: failed with status {done.returncode}: {says[-1]}")
    return done.stdout


def measure(config: Config, view: View, tool: str, compressed: list[str], folder: Path) -> dict:
    """Measure a view: {"rows": [one row per format and model]}. Keeps the formats' files."""
    source, camera = view.open()
    scene, name = source.unpacked, Path(view.scene).name
    seen, stem = Views.of(scene, [camera]), folder / name.split(".")[0]
    original = ply_bytes(len(scene), scene.sh_degree)
    about = {"scene": name, "camera": view.camera or camera.name}

    def row(title: str, held: Gaussians, degree: int, stored: int, memory: int | None) -> dict:
        db = seen.psnr_db(held)
        return about | {
            "format": title, "gaussians": len(held.position), "sh_degree": degree, "bytes": memory,
            "file_bytes": stored, "ratio": original / stored,
            "psnr_db": None if db == SAME_DB else db,
        }  # fmt: skip

    def ours(title: str, model: PackedModel, stored: int) -> dict:
        degree = model.format.sh_degree
        return row(title, model.gaussians(), degree, stored, len(model.image))

    plain = stem.with_suffix(".formats.ply")
    write_ply(plain, scene)
    rows = []
    for title, end in OTHERS.items():
        path = stem.with_name(stem.name + end)
        actions = TURNED if title == "SPZ" else ()
        called(tool, "--quiet", "--overwrite", "--gpu", "cpu", str(plain), *actions, str(path))
        held = replace(open_source(str(path)).unpacked, antialiased=scene.antialiased)
        rows.append(row(title, held.gaussians(), held.sh_degree, path.stat().st_size, None))
    plain.unlink()
    for quality in UNLEARNED:
        model = pack(scene, config, quality=quality)[0]
        rows.append(ours(quality, model, len(file_bytes(model))))
    for path in compressed:
        rows.append(ours(Path(path).name, read_model(path), Path(path).stat().st_size))
    return {"rows": rows}
