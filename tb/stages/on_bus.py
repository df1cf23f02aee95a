"""A half of the machine with its own AXI master."""

from amaranth.hdl import Cat, Module
from amaranth.lib import wiring
from amaranth.lib.wiring import Out, connect, flipped

from splatcore.hdl.memory.axi import Axi
from splatcore.hdl.memory.bus import axi
from splatcore.hdl.raster.job import WRITING
from splatcore.spec.axi import PREPROCESSING, READERS, WRITERS
from splatcore.spec.config import Config
from tb.helpers.parts import forward

INSIDE = ("reads", "data", "writes", "settled", "patient")


class OnBus(wiring.Component):
    """A half with the memory port; the other half's readers and writers are idle.

    Members: those of the half except `INSIDE`; m_axi: memory
    """

    def __init__(self, config: Config, half: int, part: wiring.Component):
        self.part, self.half, self.axi = part, half, Axi(config)
        members = part.signature.members
        self.names = [name for name in members if name not in INSIDE]
        super().__init__({name: members[name] for name in self.names} | {"m_axi": Out(axi(config))})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part, m.submodules.axi = part, port = self.part, self.axi
        forward(m, self, part, self.names)
        connect(m, port.m_axi, flipped(self).m_axi)
        readers = [k for k, of in enumerate(READERS.values()) if of == self.half]
        writers = [k for k, of in enumerate(WRITERS.values()) if of == self.half]
        for number, client in enumerate(readers):
            connect(m, part.reads[number], port.reads[client])
            connect(m, port.data[client], part.data[number])
        for number, client in enumerate(writers):
            connect(m, part.writes[number], port.writes[client])
        settled = Cat(port.settled[client] for client in writers)
        if self.half == PREPROCESSING:
            m.d.comb += part.settled.eq(settled.all())
        else:
            m.d.comb += part.settled.eq(settled)
            for name, patient in zip(WRITING, part.patient, strict=True):
                m.d.comb += port.patient[list(WRITERS).index(name)].eq(patient)
        return m
