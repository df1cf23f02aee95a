"""Steps of a compression: saved whole, found again, refused if broken or foreign."""

import json
from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.compress.checkpoint import STEPS, Checkpoints, Step, ply_bytes
from splatcore.model.formats.ply import write_ply
from splatcore.model.pack.pack import pack
from splatcore.spec.config import TINY
from splatcore.spec.error import InputError
from splatcore.spec.scene import ARRAYS
from tb.helpers.refusal import refused
from tb.helpers.scenes import random_scene

SCENE = replace(random_scene(40, 3), name="cube")


@pytest.fixture
def kept(tmp_path):
    """Checkpoints with three steps."""
    kept = Checkpoints(tmp_path / "a" / "run", "cube, 7 steps")
    kept.save("original", "original", SCENE)
    kept.save("prune 0.4 (2)", "prune", SCENE[:24], 1.5, 0.25)
    kept.save("quantize", "quantize", pack(SCENE[:24], TINY)[0], 2.0, 0.5)
    return kept


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_ply_bytes_is_the_size_of_a_ply(tmp_path, degree):
    for count in (9, 10, 123):
        scene = random_scene(count, degree)
        write_ply(tmp_path / "a.ply", scene)
        data = (tmp_path / "a.ply").read_bytes()
        assert ply_bytes(count, degree) == len(data) and b"property float nx" in data
    assert ply_bytes(1000, 3) - ply_bytes(999, 3) == 62 * 4 + 1  # one more digit in the header


def test_steps_are_found_again(kept):
    again = Checkpoints(kept.folder, kept.key)
    assert again.steps == kept.steps and again.last.name == "quantize"
    size = len(again.load(again.last).image)
    assert again.steps == (
        Step("original", "original", 40, 3, ply_bytes(40, 3), 0.0, None, "00-original.npz"),
        Step("prune 0.4 (2)", "prune", 24, 3, ply_bytes(24, 3), 1.5, 0.25, "01-prune-0.4-2.npz"),
        Step("quantize", "quantize", 24, 1, size, 2.0, 0.5, "02-quantize.splatcore"),
    )
    assert again.find("prune 0.4 (2)") == again.steps[1] and not again.find("prune 0.4")
    for name in ARRAYS:
        found = getattr(again.load(again.steps[1]), name)
        assert np.array_equal(found, getattr(SCENE[:24], name).astype(np.float32)), name
    assert again.load(again.steps[0]).name == "cube"
    assert np.array_equal(again.load(again.last).image, pack(SCENE[:24], TINY)[0].image)
    files = [STEPS, *(step.file for step in kept.steps)]
    assert sorted(path.name for path in kept.folder.iterdir()) == sorted(files)


def test_the_mark_is_kept(tmp_path):
    """Files of earlier versions have no mark: they hold an unmarked scene."""
    kept = Checkpoints(tmp_path, "key")
    marked = replace(SCENE, antialiased=True, mark="by its file")
    first, second = (kept.save(name, "original", scene) for name, scene in
                     (("marked", marked), ("unmarked", SCENE)))  # fmt: skip
    found = kept.load(first)
    assert found.antialiased is True and found.mark == "by its file" and found.name == "cube"
    assert kept.load(second).antialiased is False
    path = tmp_path / first.file
    with np.load(path) as arrays:
        old = {name: arrays[name] for name in ("name", *ARRAYS)}
    np.savez(path, **old)
    assert kept.load(first).antialiased is False and kept.load(first).name == "cube"


def test_new_folder_is_empty(tmp_path):
    empty = Checkpoints(tmp_path / "none", "key")
    assert empty.steps == () and empty.last is None and not empty.folder.exists()


def test_another_computation_is_refused_and_stays(kept):
    before = {path.name: path.read_bytes() for path in kept.folder.iterdir()}
    with pytest.raises(InputError, match=r"run: holds another .* choose another folder or remove"):
        Checkpoints(kept.folder, "cube, 8 steps")
    assert before == {path.name: path.read_bytes() for path in kept.folder.iterdir()}


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_cut_off_files_are_named(kept, share):
    for step in kept.steps:
        path = kept.folder / step.file
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        refused(step.file, kept.load, step)


def test_missing_and_exchanged_files_are_named(kept):
    first, second, third = (kept.folder / step.file for step in kept.steps)
    second.write_bytes(first.read_bytes())
    first.write_bytes(third.read_bytes())
    pack(SCENE[:23], TINY)[0].image.tofile(third)
    messages = ("is not a step's scene", "is not the scene of step", "is not the model of step")
    for step, message in zip(kept.steps, messages, strict=True):
        refused(f"{step.file}: {message}", kept.load, step)
    third.unlink()
    refused(r"02-quantize.splatcore", kept.load, kept.steps[2])


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda table: table.pop("key"), "'key' is missing"),
        (lambda table: table["steps"].append(3), "step 3: is 3"),
        (lambda table: table["steps"][1].pop("bytes"), "step 1: 'bytes' is missing"),
        (lambda table: table["steps"][0].update(kind="burn"), "step 0: 'kind' 'burn'"),
        (lambda table: table["steps"][2].update(file="../a.npz"), "'file' '../a.npz'"),
        (lambda table: table["steps"][2].update(loss="much"), "step 2: 'loss'"),
    ],
)
def test_foreign_steps_are_refused(kept, change, message):
    path = kept.folder / STEPS
    table = json.loads(path.read_text())
    change(table)
    path.write_text(json.dumps(table))
    with pytest.raises(InputError, match=r"steps.json") as error:
        Checkpoints(kept.folder, kept.key)
    assert message in str(error.value)
    path.write_text(path.read_text()[:-9])
    refused(r"steps.json: is not valid JSON", Checkpoints, kept.folder, kept.key)


@pytest.mark.parametrize("name, loss", [("original", 0.1), ("new", float("nan"))])
def test_a_step_is_kept_once_and_with_a_number_for_its_loss(kept, name, loss):
    with pytest.raises(ValueError):
        kept.save(name, "original", SCENE, loss=loss)
    assert Checkpoints(kept.folder, kept.key).steps == kept.steps


def test_what_cannot_be_written_leaves_the_steps(kept):
    """If writing a step fails before the list is updated, only that step is lost."""
    (kept.folder / ".part.npz").mkdir()
    refused(r"run: cannot be written", kept.save, "new", "original", SCENE)
    again = Checkpoints(kept.folder, kept.key)
    assert [step.name for step in again.steps] == ["original", "prune 0.4 (2)", "quantize"]
    assert again.steps == kept.steps
