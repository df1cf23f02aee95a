"""Memory, host and watchdog of the simulated machine (`sim.machine.machine`), on a small device."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from splatcore.sim.machine.areas import make_memory, place_areas
from splatcore.sim.machine.execute import execute
from splatcore.sim.machine.machine import Job, Machine, Run, host_script
from splatcore.sim.machine.script import IDEAL, LPDDR4, Report, Script, Timing
from splatcore.sim.rtl.convert import converted
from splatcore.spec.axi import BEAT
from splatcore.spec.config import TINY
from splatcore.spec.registers import INTERRUPT_FRAME, INTERRUPT_READY, ErrorCode
from tb.helpers.copier import BURST, FAULT, FAULTS, PAGES, POINTS, SIZE, Copier, jobs, models

pytestmark = pytest.mark.slow

BEATS = SIZE[0] * SIZE[1] * 3 // BEAT


@pytest.fixture(scope="module")
def machine() -> Machine:
    return Machine(TINY, converted(Copier()))


def run(machine: Machine, timing: Timing, fault: str = "none", **options) -> Run:
    sizes = {"features": FAULT + FAULTS.index(fault)}
    return machine.run(jobs(), timing, sizes=sizes, **options)


@pytest.mark.parametrize("timing", [IDEAL, LPDDR4, replace(LPDDR4, stall=0.5, seed=3)])
def test_frames_come_as_they_should(machine, timing):
    """A start counts from its answer, which stalls delay."""
    late, seen = 20 if timing.stall else 5, []
    found = machine.run(jobs(4), timing, lambda *step: seen.append(step), {"features": FAULT})
    assert found.done and found.state["NEEDED"] == PAGES, found.why
    for k, frame in enumerate(found.frames):
        copied = models()[k % 2].image[: BEATS * BEAT]
        np.testing.assert_array_equal(frame.pixels.ravel(), copied)
        assert frame.counters["points_points"] == BEATS
        assert frame.started + POINTS - late <= frame.ready < frame.finished
        assert ("raster_pairs" in frame.counters) == (k == 3)
    assert len(found.frame_cycles) == 3 and min(found.frame_cycles) >= BEATS
    assert found.report.regions["image0"] == (0, 2 * BEATS * BEAT)
    assert found.report.traffic == {
        "read_model": 4 * BEATS * BEAT,
        "write_features": 4 * BEATS * BEAT,
    }
    assert not found.report.outside


def test_progress_is_reported(machine):
    """A run of a few seconds; progress is reported twice per second."""
    seen = []
    slow = replace(IDEAL, bandwidth=0.001)
    found = machine.run(jobs(), slow, lambda *step: seen.append(step), {"features": FAULT})
    assert found.done
    cycles, written, total = zip(*seen, strict=True)
    assert set(total) == {BEATS * BEAT} and cycles == tuple(sorted(cycles))
    assert 0 < written[-1] <= total[0]


@pytest.mark.parametrize(
    "bandwidth, granule, cycles",
    [(0, 0, BEATS), (32, 32, BEATS), (8, 0, 4 * BEATS), (8, 32, 4 * BEATS), (8, 128, 8 * BEATS)],
)
def test_bandwidth(machine, bandwidth, granule, cycles):
    """Reads and writes share the bandwidth; a burst of 64 bytes wastes half of a granule of 128."""
    timing = Timing("test", latency=4, bandwidth=bandwidth, granule=granule)
    frame = run(machine, timing).frames[0]
    saved = 2 * granule // max(bandwidth, 1)  # tokens from before the first access
    assert cycles - saved <= frame.finished - frame.ready <= cycles + 40


def test_latency(machine):
    """A burst's first beat and its answer have the latency; several bursts are in flight."""
    base, slow = (Timing("test", latency=cycles) for cycles in (4, 24))
    timings = base, slow, replace(slow, outstanding=1)
    base, late, one = (run(machine, timing).frames[0] for timing in timings)
    assert late.finished - late.ready == base.finished - base.ready + 2 * 20
    assert one.finished - one.ready > BEATS // BURST * (24 + 24 + BURST - 1) / 2


def test_read_errors(machine):
    found = run(machine, replace(IDEAL, read_errors=(BEATS // 2,)))
    assert found.error == ErrorCode.READ and found.detail == 3 and not found.done
    assert found.report.result == "error" and found.frames[0].pixels is None
    assert run(machine, replace(IDEAL, read_errors=(BEATS,))).done


def test_write_errors(machine):
    found = run(machine, replace(IDEAL, write_errors=(BEATS // BURST - 1,)))
    assert found.error == ErrorCode.WRITE and "ERROR WRITE, detail 3" in found.why
    assert run(machine, replace(IDEAL, write_errors=(BEATS // BURST,))).done


@pytest.mark.parametrize(
    "fault, rule",
    [
        ("ar", "AR was not kept"), ("aw", "AW was not kept"), ("w", "W was not kept"),
        ("last", "WLAST"), ("boundary", "crosses a boundary"), ("size", "neither whole beats"),
    ],
)  # fmt: skip
def test_rules(machine, fault, rule):
    found = run(machine, replace(IDEAL, stall=0.6, seed=5), fault)
    assert found.report.result == "rule" and rule in found.why


def test_outside(machine):
    """An access outside of all regions is answered by an error and reported."""
    found = run(machine, IDEAL, "outside")
    assert found.error == ErrorCode.READ and found.report.outside == 1
    assert "read of model, 64 bytes at 0x0" in found.why


def test_the_model_is_not_written(machine):
    """A write to a read-only region is refused: the image is placed at the model."""
    [job] = jobs()
    areas = job_areas(job)
    script, _, _ = host_script(TINY, [job], [job.model], areas)
    places = [f"write {script.addresses[name]} " for name in ("PIXELS", "MODEL")]
    script.lines = [
        f"{places[0]}{areas.models[0]}" if line.startswith(places[0]) else line
        for line in script.lines
    ]
    report, _ = executed(machine, script, areas, job)
    assert report.outside == BEATS // BURST


def test_hang(machine):
    found = run(machine, IDEAL, "hang", idle_max=500)
    assert found.report.result == "hang" and "STATUS" in found.state
    assert 500 < found.report.cycles < 1500
    late = replace(IDEAL, latency=450)
    assert run(machine, late, idle_max=500).done


def test_limit(machine):
    assert run(machine, IDEAL, cycles_max=300).report.result == "limit"


def test_writes_are_seen_from_their_answers_on(machine):
    """A machine that signals FRAME before memory's answers has signalled it too early."""
    timing = replace(IDEAL, latency=100)
    found = run(machine, timing, "early")
    assert found.done
    copied = models()[0].image[: BEATS * BEAT].reshape(found.frames[0].pixels.shape)
    assert (found.frames[0].pixels[-1, -20:] != copied[-1, -20:]).mean() > 0.9


def test_more_pages(machine):
    sizes = {"features": FAULT, "pages": PAGES - 1}
    found = machine.run(jobs(), sizes=sizes)
    assert found.done and found.areas.pages == PAGES
    found = machine.run(jobs(), sizes=sizes, retry=False)
    assert found.error == ErrorCode.PAGES and not found.done


def test_reset_in_mid_frame(machine):
    """Memory drops requests from before the reset."""
    [job] = jobs()
    areas = job_areas(job)
    script = Script(TINY)
    first, _, _ = host_script(TINY, [job], [job.model], areas)
    begun = next(k for k, line in enumerate(first.lines) if line.startswith("wait"))
    script.lines = [*first.lines[:begun], "cycles 90", "reset 3", *first.lines]
    report, saved = executed(machine, script, areas, job)
    assert report.done and len(report.events) == 2
    assert report.read["model"] > BEATS
    assert saved == job.model.image[: BEATS * BEAT].tobytes()


def test_two_ends_before_the_host_looks(machine):
    """One FRAME stands for both, and FINISHED counts them; a reset restarts the count."""
    [job] = jobs()
    areas, script = job_areas(job), Script(TINY)
    first, _, _ = host_script(TINY, [job], [job.model], areas)
    begun = next(k for k, line in enumerate(first.lines) if line.startswith("wait"))
    two = [*first.lines[:begun], f"wait {INTERRUPT_READY}", first.lines[begun - 1]]
    two += ["cycles 5000", f"wait {INTERRUPT_READY}", *[f"wait {INTERRUPT_FRAME}"] * 2]
    script.lines = [*two, "reset 3", *two]
    report, _ = executed(machine, script, areas, job)
    assert report.done, report.why
    assert [bits for _, bits in report.events] == [
        INTERRUPT_READY, INTERRUPT_READY, INTERRUPT_FRAME, INTERRUPT_FRAME,
    ] * 2  # fmt: skip


def job_areas(job: Job):
    return place_areas(TINY, [job.model], [SIZE], features=FAULT)


def executed(machine: Machine, script: Script, areas, job: Job) -> tuple[Report, bytes]:
    """Run a script on a job's memory; the report and the image that it saved."""
    with TemporaryDirectory() as name:
        make_memory(Path(name), areas, [job.model])
        report = execute(machine.program, Path(name), script, areas, LPDDR4)
        saved = Path(name) / "pixels.0"
        return report, saved.read_bytes() if saved.exists() else b""
