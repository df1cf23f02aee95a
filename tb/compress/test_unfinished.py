"""Interrupted fine-tuning resumes from its last state, and ends with the same bits."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from splatcore.model.compress import compress as compress_module
from splatcore.model.compress.checkpoint import Checkpoints
from splatcore.model.compress.codebooks import in_codebooks
from splatcore.model.compress.compress import compress
from splatcore.model.compress.significance import Directions
from splatcore.model.compress.steps import InSteps
from splatcore.model.gradients import finetune as finetune_module
from splatcore.model.gradients.finetune import Unfinished
from splatcore.model.gradients.trainable import refining, tensors_of
from splatcore.spec.config import DEFAULT
from splatcore.spec.error import InputError
from tb.helpers.compression_scene import RECIPE
from tb.helpers.refusal import refused

STOPS = {"distill 2": 3, "distill 1": 3, "prune 0.3": 5, "prune 0.2": 5, "quantize": 5}
"""Phase → step after which the test stops it, once."""


class Stop(Exception):
    pass


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """Save a state every two steps; refresh codebooks and steps every three."""
    monkeypatch.setattr(finetune_module, "KEEP_EVERY", 2)
    monkeypatch.setattr(compress_module, "REFRESH", 3)


@pytest.mark.parametrize("degree", [1, 2])
def test_stopped_in_every_phase(scene, targets, tmp_path, degree):
    """In codebooks and in steps: resuming repeats only the steps after the last saved state."""
    recipe, reports = replace(RECIPE, degree=degree), []
    whole, broken = (Checkpoints(tmp_path / name, "key") for name in ("whole", "broken"))
    *_, wanted = compress(scene, targets, recipe, whole)

    def progress(phase, done, total, loss):
        if loss is None:
            return
        reports.append((phase, done))
        if done == STOPS[phase] and reports.count((phase, done)) == 1:
            raise Stop

    stops = 0
    while not broken.find("quantize"):
        try:
            list(compress(scene, targets, recipe, broken, DEFAULT, progress))
        except Stop:
            stops += 1
            assert broken.unfinished.exists()
            broken = Checkpoints(broken.folder, broken.key)
    phases = list(dict.fromkeys(phase for phase, _ in reports))
    assert phases == [phase for phase in STOPS if degree == 1 or phase != "distill 1"]
    assert stops == len(phases)
    for phase in phases:
        steps = [done for name, done in reports if name == phase]
        stop = STOPS[phase]
        assert steps == [*range(1, stop + 1), stop, stop + 1], phase
    assert not list(broken.folder.glob("*.pt")) and len(broken.steps) == len(whole.steps)
    assert [step.loss for step in broken.steps] == [step.loss for step in whole.steps]
    found = broken.load(broken.last)
    assert np.array_equal(found.image, whole.load(wanted).image)


@pytest.mark.parametrize("degree", [1, 2])
def test_what_refresh_took_is_kept(scene, tmp_path, degree):
    """A state restores all that refresh() computed: units, grids of positions and of harmonics,
    entries. A fresh object that loads it renders the same bits."""
    start = scene.with_sh_degree(degree)

    def begin():
        if degree == 2:
            return InSteps(tensors_of(start), DEFAULT, "balanced")
        count = len(start)
        seen = Directions(np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3)))
        return in_codebooks(start, np.ones(count), seen, DEFAULT, 0)

    def adams(work):
        leaves, rates = work.leaves()
        return refining(leaves, 1.0, rates)

    first, second = begin(), begin()
    before = [each.detach().clone() for each in first.rendered(first.tensors)]
    rng = torch.Generator().manual_seed(0)
    for _ in range(2):
        with torch.no_grad():
            for leaf in first.tensors.values():
                leaf += torch.randn(leaf.shape, generator=rng)
        first.refresh()
    kept = Unfinished(tmp_path / "a.pt", first.taken)
    kept.save(adams(first), 1, 0.5)
    Unfinished(kept.path, second.taken).load(adams(second))
    changed = first.rendered(first.tensors)
    for found, wanted, old in zip(second.rendered(second.tensors), changed, before, strict=True):
        assert torch.equal(found, wanted) and not torch.equal(wanted, old)
    assert not torch.equal(first.unit, begin().unit)


def state_of(*leaves: torch.Tensor):
    """Optimizers of leaves [N] after one step."""
    for leaf in leaves:
        leaf.grad = torch.ones_like(leaf)
    adams = {str(k): torch.optim.Adam([leaf], lr=0.5) for k, leaf in enumerate(leaves)}
    for adam in adams.values():
        adam.step()
    return adams


def test_nothing_is_kept_at_first(tmp_path):
    assert Unfinished(tmp_path / "a.pt").load({}) == (0, None)


def test_learning_rates_are_those_of_the_caller(tmp_path):
    """A state holds parameters and moments, not learning rates."""
    adams = state_of(torch.zeros(3, requires_grad=True))
    kept = Unfinished(tmp_path / "a.pt")
    kept.save(adams, 7, 0.25)
    leaf = torch.ones(3, requires_grad=True)
    again = {"0": torch.optim.Adam([leaf], lr=0.125)}
    assert kept.load(again) == (7, 0.25)
    assert torch.allclose(leaf, torch.full((3,), -0.5)) and leaf.requires_grad
    assert again["0"].param_groups[0]["lr"] == 0.125
    assert int(again["0"].state[leaf]["step"]) == 1


def test_broken_states_are_named(tmp_path):
    kept = Unfinished(tmp_path / "a.pt")
    adams = state_of(torch.zeros(3, requires_grad=True))
    kept.save(adams, 1, 0.5)
    whole = kept.path.read_bytes()
    others = [state_of(torch.ones(1, requires_grad=True)), state_of(torch.ones(3), torch.ones(3))]
    for other in others:
        refused(r"a.pt: belongs to a different fine-tuning; remove", kept.load, other)
    for share in (0.0, 0.5, 0.99):
        kept.path.write_bytes(whole[: int(share * len(whole))])
        refused(r"a.pt: is not a state of .*; remove it", kept.load, adams)


def test_what_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"gone/a.pt: cannot be written"):
        Unfinished(tmp_path / "gone" / "a.pt").save({}, 1, 0.5)
