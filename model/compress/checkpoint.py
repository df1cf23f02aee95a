"""The finished steps of a compression, kept in a folder so that an interrupted run can resume.

`steps.json` holds the key of the computation, the choice of the model, and the list of steps. Each
step has its own file next to it: a scene (.npz with the arrays of `Scene` as float32, its name and
its mark) or a packed model (.splatcore). An unfinished step may keep its state there (.pt).
"""

import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import get_type_hints

import numpy as np

from splatcore.model.formats import file, ply
from splatcore.model.formats.file import input_error, reading
from splatcore.model.formats.model_file import read_model
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import ARRAYS, Scene

STEPS = "steps.json"
MARK = ("antialiased", "mark")  # fields of a scene
KINDS = ("original", "prune", "distill", "quantize")
Result = Scene | PackedModel


def ply_bytes(count: int, degree: int) -> int:
    """Size in bytes of a PLY of the original 3DGS: float32, all attributes, with normals."""
    start, columns = ply.header(count, degree)
    return len(start) + 4 * count * columns


@dataclass(frozen=True)
class Step:
    """A finished step."""

    name: str  # "original", "prune 0.4", "prune 0.4 (2)", "distill 1", "quantize"
    kind: str  # one of KINDS
    gaussians: int
    sh_degree: int
    bytes: int  # of its PLY (`ply_bytes`) or packed model
    seconds: float  # time it took
    loss: float | None  # of its fine-tuning, if any
    file: str  # next to steps.json


class Checkpoints:
    """The steps of one computation, kept in a folder."""

    def __init__(self, folder: Path, key: str):
        """Open a folder, which need not exist yet; nothing in it is ever removed.

        key: identifies the computation (scene, options)
        Raises InputError if the folder holds the steps of another computation.
        """
        self.folder, self.key = Path(folder), key
        self.steps: tuple[Step, ...] = ()
        self.choice: dict | None = None
        path = self.folder / STEPS
        if path.exists():
            table = file.checked(file.parse_json(file.read_bytes(path), path), dict, path)
            if file.field(table, "key", str, path) != key:
                why = "holds another compression's steps; choose another folder or remove it"
                raise input_error(self.folder, why)
            if table.get("choice") is not None:
                self.choice = file.field(table, "choice", dict, path)
            found = enumerate(file.field(table, "steps", list, path))
            self.steps = tuple(_step(entry, f"{path}: step {k}") for k, entry in found)

    @property
    def last(self) -> Step | None:
        return self.steps[-1] if self.steps else None

    @property
    def unfinished(self) -> Path:
        """File for the state of the unfinished step; removed when that step is saved."""
        return self.folder / f"{len(self.steps):02}-unfinished.pt"

    def find(self, name: str) -> Step | None:
        """The step of that name, or None."""
        return next((step for step in self.steps if step.name == name), None)

    def choose(self, make: Callable[[], dict]) -> dict:
        """The kept choice (JSON), or that of `make`, which is then kept."""
        if self.choice is None:
            self.choice = make()
            with reading(self.folder, "cannot be written"):
                self.folder.mkdir(parents=True, exist_ok=True)
                self._write(self.steps)
        return self.choice

    def _write(self, steps: Sequence[Step]):
        """Write the table, entirely or not at all."""
        table = {"key": self.key, "choice": self.choice, "steps": [asdict(each) for each in steps]}
        part = self.folder / ".part.json"
        part.write_text(json.dumps(table, indent=1, allow_nan=False) + "\n")
        os.replace(part, self.folder / STEPS)

    def save(
        self, name: str, kind: str, result: Result, seconds: float = 0.0, loss: float | None = None
    ) -> Step:
        """Keep a finished step with its scene or packed model.

        Scenes are kept in float32: continue from `load(step)`, as a resumed run does.
        """
        if self.find(name):
            raise ValueError(f"step {name!r} already exists")
        packed = isinstance(result, PackedModel)
        degree = result.format.sh_degree if packed else result.sh_degree
        size = len(result.image) if packed else ply_bytes(len(result), degree)
        suffix = ".splatcore" if packed else ".npz"
        words = re.sub(r"[^\w.]+", "-", name).strip("-")
        place = f"{len(self.steps):02}-{words}{suffix}"
        step = Step(name, kind, len(result), degree, size, seconds, loss, place)
        with reading(self.folder, "cannot be written"), np.errstate(over="ignore"):
            self.folder.mkdir(parents=True, exist_ok=True)
            part = self.folder / f".part{suffix}"
            if packed:
                result.image.tofile(part)
            else:
                arrays = {array: getattr(result, array).astype(np.float32) for array in ARRAYS}
                words = {name: getattr(result, name) for name in ("name", *MARK)}
                np.savez(part, **words, **arrays)
            os.replace(part, self.folder / step.file)
            self._write((*self.steps, step))
            self.unfinished.unlink(missing_ok=True)
        self.steps += (step,)
        return step

    def load(self, step: Step) -> Result:
        """The scene of a step, or the model of "quantize"; InputError names the broken file."""
        path = self.folder / step.file
        if step.kind == "quantize":
            model = read_model(path)
            if len(model) != step.gaussians:
                raise input_error(model.name, f"is not the model of step {step.name!r}")
            return model
        with reading(path, "is not a step's scene"), np.load(path, allow_pickle=False) as arrays:
            scene = Scene(*(arrays[array] for array in ARRAYS), str(path))
            scene = replace(scene, name=str(arrays["name"]))
            if MARK[0] in arrays:  # a file without the mark holds an unmarked scene
                antialiased, mark = (arrays[name] for name in MARK)
                scene = replace(scene, antialiased=bool(antialiased), mark=str(mark))
            if (len(scene), scene.sh_degree) != (step.gaussians, step.sh_degree):
                raise input_error(path, f"is not the scene of step {step.name!r}")
        return scene


def _step(entry: object, where: str) -> Step:
    """A checked entry of steps.json."""
    entry, kinds = file.checked(entry, dict, where), get_type_hints(Step)
    kinds.pop("loss")
    values = {name: file.field(entry, name, kind, where) for name, kind in kinds.items()}
    if values["kind"] not in KINDS or not re.fullmatch(r"[\w][\w.-]*", values["file"]):
        raise input_error(where, f"'kind' {values['kind']!r} or 'file' {values['file']!r} is wrong")
    loss = None if entry.get("loss") is None else file.field(entry, "loss", float, where)
    return Step(**values, loss=loss)
