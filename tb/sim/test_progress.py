"""Progress: phases that code reports, and the time left."""

import io
import signal

import pytest
from rich.console import Console

from splatcore.sim.common import output
from splatcore.sim.common.output import Phase, progress_bar
from splatcore.spec import progress
from splatcore.spec.progress import counted, report, shown_by


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test sets."""
    now = [100.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    return now


def test_the_time_left(clock):
    """From the speed since the phase began; none without a total, a start or an end."""
    phase = Phase("reading", None)
    clock[0] += 7
    assert phase.line == "reading, 7 s"
    phase.advance(0, 10, "packing")
    clock[0] += 3
    assert phase.line == "packing 0/10, 10 s"
    phase.advance(2, 10, "packing")
    assert phase.line == "packing 2/10, 10 s, 12 s left"
    clock[0] += 1
    phase.advance(4, 10, "codebooks")  # the same phase: the total is the same
    assert phase.line == "codebooks 4/10, 11 s, 6 s left"
    phase.advance(10, 10, "packing")
    assert phase.line == "packing 10/10, 11 s"


@pytest.mark.parametrize("done, total", [(20, 40), (1, 10)])
def test_another_phase_has_its_own_speed(clock, done, total):
    """It begins with another total, or where less is done than before."""
    phase = Phase("order", 10)
    clock[0] += 50
    phase.advance(9, 10, "order")
    phase.advance(done, total, "layout")
    clock[0] += 2
    phase.advance(done + 4, total, "layout")
    assert phase.line.endswith(f"52 s, {2 * (total - done - 4) / 4:.0f} s left")


def test_reported_phases_are_shown_after_the_label(monkeypatch):
    text = io.StringIO()
    monkeypatch.setattr(output, "messages", Console(file=text, force_terminal=True, width=90))
    with progress_bar("reading a.ply"):
        report("rows", 3, 7)
    assert "reading a.ply: rows" in text.getvalue() and "3/7" in text.getvalue()
    with progress_bar("reading a.ply") as advance:
        advance(0, None, "packing a.ply")
        report("order", 4, 9)
    assert "packing a.ply: order" in text.getvalue() and "4/9" in text.getvalue()
    report("order", 5, 9)
    assert "5/9" not in text.getvalue()


def test_items_are_counted():
    """Each is reported before it is worked on, and the end; only the innermost display shows it."""
    found, outer = [], []
    with shown_by(lambda *state: outer.append(state)), shown_by(lambda *state: found.append(state)):
        assert [len(found) for _ in counted("rows", "abc")] == [1, 2, 3]
    assert found == [(done, 3, "rows") for done in range(4)] and not outer
    with shown_by(lambda *state: outer.append(state)):
        assert list(counted("rows", iter("ab"), 2)) == ["a", "b"]
    assert outer == [(done, 2, "rows") for done in range(3)]


def test_a_lost_interrupt_is_raised_again(monkeypatch):
    """By the next report, and by the next step of a bar."""
    monkeypatch.setattr(progress, "_interrupts", [])
    monkeypatch.setattr(signal, "getsignal", lambda number: signal.default_int_handler)
    handlers = {}
    monkeypatch.setattr(signal, "signal", handlers.__setitem__)
    progress.raise_again()
    progress.report("tiles", 1, 2)
    with pytest.raises(KeyboardInterrupt):
        handlers[signal.SIGINT](signal.SIGINT, None)
    with pytest.raises(KeyboardInterrupt):
        progress.report("tiles", 2, 2)
    with pytest.raises(KeyboardInterrupt), progress_bar("rendering"):
        pass
