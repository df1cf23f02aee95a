"""Proof of the AXI4 master; each planted fault breaks it."""

import pytest

from splatcore.hdl.memory import axi
from splatcore.hdl.memory.axi import Axi
from splatcore.sim.rtl.formal import ProofError, cover, prove, search
from splatcore.spec import axi as spec
from splatcore.spec.config import TINY
from tb.formal.axi_master import Master
from tb.helpers.ports import other_port, wide_addresses
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

COVER_DEPTH = 12  # cycles within which every cover is reached
FAULT_DEPTH = 7  # cycles within which every planted fault shows


def test_master_is_proved():
    prove(Master(Axi(TINY)))


def test_all_is_reached():
    cover(Master(Axi(TINY)), COVER_DEPTH)


@pytest.mark.verify
def test_master_of_a_wide_port_is_proved():
    prove(Master(Axi(other_port(TINY))))


WIDE = wide_addresses(TINY)


@pytest.mark.verify
def test_master_of_wide_addresses_is_proved():
    prove(Master(Axi(WIDE)))


LEFT = "(count > addresses) & (count > lasts)"

FAULTS = {
    "done before its last beat": ("_answers", LEFT, "(count > addresses)"),
    "done before its address": ("_answers", LEFT, "(count > lasts)"),
    "surplus answers are counted": ("_answers", f"Mux({LEFT}, mine, 0)", "mine"),
    "a stray's error is reported": ("_answers", "answered.any() & error", "full & error"),
    "an answer before its request": ("_return", "self.asked[half] > waits", "self.asked[half] > 0"),
    "a stray blocks the channel": ("_return", "fire.any() | stray)", "fire.any())"),
    "a stray beat is not reported": ("_return", "self.stray.valid.eq(1)", "self.stray.valid.eq(0)"),
    "a beat to a half that fails": ("_return", "target[k] & ~self.failing[half]", "target[k]"),
    "a beat is lost": ("_return", "m_axi.rready.eq(~full", "m_axi.rready.eq(1"),
    "any beat is the last one": ("_return", ".any() & beat.last", ".any()"),
    "a burst ends early": ("_write", "left == 1", "left == 2"),
    "another length is announced": ("_write", "length.eq(given.length)", "length.eq(0)"),
    "an address without its beat": ("_write", "wants.any() & beat.ready", "wants.any()"),
    "a beat without its address": ("_write", "wants.any() & address.ready", "wants.any()"),
    "another's ID": ("_write", "client.eq(encoded(turns.chosen))", "client.eq(encoded(owner))"),
    "a half that fails still writes": ("_write", "Mux(abandoned, 0, given.strobe)", "given.strobe"),
    "more than can be counted": ("_write", "full[k].eq(self.bursts[k].all())", "full[k].eq(0)"),
    "an offer is withdrawn": ("_address", "request.valid,", "request.valid & ~self.failing[0],"),
    "another address": ("_address", "burst.beat[below:]", "~burst.beat[below:]"),
    "another reader's window": ("_ask", "chosen, self.read_w", "wants, self.read_w"),
    "another writer's window": ("_write", "chosen, self.write_w", "wants, self.write_w"),
    "a window that is not kept": ("_address", "request.payload.window", "self.read_windows[0]"),
    "idle while reads are open": ("elaborate", "(self.asked[half] == 0) & settled", "settled"),
}


@pytest.fixture
def small(monkeypatch):
    """Use few clients, of both halves, and small counters, so that a search is quick."""
    monkeypatch.setattr(spec, "READERS", {"a": 0, "b": 1, "c": 1})
    monkeypatch.setattr(spec, "WRITERS", {"a": 0, "b": 1, "c": 1})
    monkeypatch.setattr(axi, "OUTSTANDING_BITS", 2)


@pytest.mark.parametrize("config", [TINY, WIDE], ids=lambda config: config.name)
def test_small_master_is_proved(config, small):
    prove(Master(Axi(config)))


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, small, monkeypatch):
    plant(monkeypatch, Axi, *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        search(Master(Axi(WIDE)), FAULT_DEPTH)
