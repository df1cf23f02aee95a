"""The notebook docs/own_scene.ipynb runs on the generated garden and on a scene file."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import splatcore
from splatcore.sim.frame.picture import read_png
from tb.helpers.clouds import cloud
from tb.helpers.command import ROOT

NOTEBOOK = ROOT / "docs" / "own_scene.ipynb"

CELLS = 10  # code cells

CHOICE = 'SCENE = "garden"'

KEPT = ["golden.png", "reference.png", "scene.splatcore", "speed.png"]

SECONDS = 300  # limit per cell, so that a hanging kernel does not hang the tests


def executed(folder: Path, scene: str | None = None) -> nbformat.NotebookNode:
    """Execute the notebook, with another scene if one is named, and return it."""
    notebook = nbformat.read(NOTEBOOK, 4)
    first = notebook.cells[2]
    assert first.source.count(CHOICE) == 1
    if scene:
        first.source = first.source.replace(CHOICE, f"SCENE = {scene!r}")
    resources = {"metadata": {"path": str(folder)}}
    return NotebookClient(notebook, timeout=SECONDS, resources=resources).execute()


def printed(notebook: nbformat.NotebookNode) -> str:
    """Text that the cells printed, warnings included."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    return "".join(output.text for output in outputs if output.output_type == "stream")


def test_committed_without_outputs():
    notebook = nbformat.read(NOTEBOOK, 4)
    nbformat.validate(notebook)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(cells) == CELLS
    assert not any(cell.outputs or cell.execution_count for cell in cells)
    assert NOTEBOOK.stat().st_size < 20_000


@pytest.mark.slow
def test_garden(tmp_path):
    """The notebook draws four figures, prints this scene's numbers and writes its files."""
    found = executed(tmp_path)
    text = printed(found)
    assert "20,000 Gaussians, harmonics of degree 1, 1 cameras" in text
    assert "compact    21.76 bytes per Gaussian" in text and "raster binds" in text
    pictures = [out for cell in found.cells for out in cell.get("outputs", ()) if "data" in out]
    assert sum("image/png" in out.data for out in pictures) == 4
    assert "Warning" not in text
    assert sorted(path.name for path in (tmp_path / "own_scene").iterdir()) == KEPT
    golden = read_png(tmp_path / "own_scene" / "golden.png")
    model = splatcore.open_scene(tmp_path / "own_scene" / "scene.splatcore")
    [camera] = splatcore.open_cameras("garden", 480, 270)
    assert (golden == splatcore.render_golden(model, camera)).all()


@pytest.mark.slow
def test_own_file(tmp_path):
    """A scene file of degree 3 without cameras also runs."""
    splatcore.write(tmp_path / "mine.ply", cloud(1, 200, 3))
    text = printed(executed(tmp_path, "mine.ply"))
    assert "200 Gaussians, harmonics of degree 3, 1 cameras" in text
    assert sorted(path.name for path in (tmp_path / "own_scene").iterdir()) == KEPT
