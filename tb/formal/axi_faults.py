"""The proofs of the AXI4 master, and planted faults that break them."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from splatcore.hdl.memory import axi
from splatcore.hdl.memory.axi import Axi
from splatcore.spec import axi as spec
from splatcore.spec.config import TINY, Config
from tb.formal.axi_master import Master
from tb.formal.proof import Part, Proof
from tb.helpers.configs import other_port, wide_addresses
from tb.planted.fault import planted_in

COVER_DEPTH = 12  # cycles within which every cover is reached
FAULT_DEPTH = 7  # cycles within which every planted fault shows

WIDE = wide_addresses(TINY)

LEFT = "(count > addresses) & (count > lasts)"

FAULTS = planted_in(
    Axi,
    _answers={
        "done before its last beat": (LEFT, "(count > addresses)"),
        "done before its address": (LEFT, "(count > lasts)"),
        "surplus answers are counted": (f"Mux({LEFT}, mine, 0)", "mine"),
        "a stray's error is reported": ("answered.any() & error", "full & error"),
    },
    _return={
        "an answer before its request": ("self.asked[half] > waits", "self.asked[half] > 0"),
        "a stray blocks the channel": ("fire.any() | stray)", "fire.any())"),
        "a stray beat is not reported": ("self.stray.valid.eq(1)", "self.stray.valid.eq(0)"),
        "a beat to a half that fails": ("target[k] & ~self.failing[half]", "target[k]"),
        "a beat is lost": ("m_axi.rready.eq(~full", "m_axi.rready.eq(1"),
        "any beat is the last one": (".any() & beat.last", ".any()"),
    },
    _write={
        "a burst ends early": ("left == 1", "left == 2"),
        "another length is announced": ("length.eq(given.length)", "length.eq(0)"),
        "an address without its beat": ("wants.any() & beat.ready", "wants.any()"),
        "a beat without its address": ("wants.any() & address.ready", "wants.any()"),
        "another's ID": ("client.eq(encoded(turns.chosen))", "client.eq(encoded(owner))"),
        "a half that fails still writes": ("Mux(abandoned, 0, given.strobe)", "given.strobe"),
        "more than can be counted": ("full[k].eq(self.bursts[k].all())", "full[k].eq(0)"),
        "another writer's window": ("chosen, self.write_w", "wants, self.write_w"),
    },
    _address={
        "an offer is withdrawn": ("request.valid,", "request.valid & ~self.failing[0],"),
        "another address": ("burst.beat[below:]", "~burst.beat[below:]"),
        "a window that is not kept": ("request.payload.window", "self.read_windows[0]"),
    },
    _ask={"another reader's window": ("chosen, self.read_w", "wants, self.read_w")},
    elaborate={"idle while reads are open": ("(self.asked[half] == 0) & settled", "settled")},
)


@contextmanager
def small() -> Iterator[None]:
    """Few clients, of both halves, and small counters, so that a search is quick."""
    clients = {"a": 0, "b": 1, "c": 1}
    with (
        patch.object(spec, "READERS", clients),
        patch.object(spec, "WRITERS", clients),
        patch.object(axi, "OUTSTANDING_BITS", 2),
    ):
        yield


def part(config: Config, **about) -> Part:
    return Part(lambda: Master(Axi(config)), **about)


PROOF = Proof(
    {
        "master": part(TINY, cover=COVER_DEPTH),
        "other port": part(other_port(TINY)),
        "wide addresses": part(WIDE, verify=True),
        "small": part(TINY, setting=small),
        "small, wide addresses": part(WIDE, setting=small),
    },
    FAULTS,
    {"": part(WIDE, search=FAULT_DEPTH, setting=small)},
)
