"""A LiteX system with the machine: a host on a UART, the machine's registers, shared SDRAM.

LiteX and LiteDRAM provide the surroundings: the UART as a bus master (UARTBone), the SDRAM's
controller and its AXI4 port, clocks and pins. `add_machine` works for systems of other boards too.
"""

import json
import re

from amaranth.hdl import Shape
from amaranth.lib.wiring import Out
from litedram import init, modules
from litedram.frontend.axi import LiteDRAMAXI2Native
from litedram.phy import GENSDRPHY
from litedram.phy.model import SDRAM_VERBOSE_STD, SDRAMPHYModel
from litex.build.generic_platform import GenericPlatform, Pins, Subsignal
from litex.build.sim import SimPlatform
from litex.soc.integration.export import get_csr_json
from litex.soc.integration.soc import SoCRegion
from litex.soc.integration.soc_core import SoCCore
from litex.soc.interconnect.axi import AXIInterface, AXILiteInterface
from litex_boards.platforms import radiona_ulx3s
from litex_boards.targets.radiona_ulx3s import _CRG as Ulx3sClocks
from migen import ClockSignal, Instance, Module, ResetSignal
from migen.genlib.io import CRG

from splatcore.eda.deliver.verilog import NAMES
from splatcore.hdl.memory.bus import axi, axi_lite
from splatcore.spec.axi import ADDRESS_BITS, ID_BITS, LITE_ADDRESS_BITS, LITE_DATA_BITS, window_bits
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

REGISTERS, REGISTERS_BYTES = 0x3000_0000, 1 << LITE_ADDRESS_BITS
"""Bus address of the machine's registers, and size of their region in bytes."""

MEMORY = "main_ram"
"""LiteX's name for the SDRAM's region."""

SIMULATED_PINS = [
    ("sys_clk", 0, Pins(1)),
    ("sys_rst", 0, Pins(1)),
    ("serial", 0, Subsignal("tx", Pins(1)), Subsignal("rx", Pins(1))),
]

BITS = {"COMMAND_CS": 1, "COMMAND_WE": 2, "COMMAND_CAS": 4, "COMMAND_RAS": 8}
BITS |= {"CONTROL_SEL": 1, "CONTROL_CKE": 2, "CONTROL_ODT": 4, "CONTROL_RESET_N": 8}
"""Bits of the LiteDRAM registers with which software drives the SDRAM's pins; SEL hands the pins
back to the controller."""


class System(SoCCore):
    """A system without a processor: UART, SDRAM and the machine on one bus of 32 bits."""

    def __init__(
        self, platform: GenericPlatform, clocks: Module, phy: Module,
        module: modules.SDRAMModule, clock_hz: int, baud: int, config: Config
    ):  # fmt: skip
        self.submodules.crg, self.submodules.sdrphy = clocks, phy
        SoCCore.__init__(
            self, platform, clock_hz, cpu_type=None, ident="", with_uart=False, with_timer=False,
            integrated_rom_size=0, integrated_sram_size=0
        )  # fmt: skip
        self.add_uartbone(baudrate=baud)
        self.add_sdram("sdram", phy=phy, module=module, l2_cache_size=0)
        add_machine(self, config)
        self.clock_hz, self.settings = clock_hz, (phy.settings, module.timing_settings)


def add_machine(system: SoCCore, config: Config):
    """Add the machine to a system with SDRAM: its registers on the bus, its master on the SDRAM."""
    memory = AXIInterface(config.port, ADDRESS_BITS, id_width=ID_BITS)
    host = AXILiteInterface(LITE_DATA_BITS, ADDRESS_BITS)
    wires = {"i_clk": ClockSignal("sys"), "i_rst": ResetSignal("sys")}
    for bus, there, signature in (
        ("m_axi", memory, axi(config)),
        ("s_axi", host, axi_lite().flip()),
    ):
        for name, member in signature.members.items():
            channel, field = re.fullmatch("(aw|ar|w|b|r)(.+)", name).groups()
            signal = getattr(getattr(there, channel), field)
            direction = "o" if member.flow == Out else "i"
            wires[f"{direction}_{bus}__{name}"] = signal[: Shape.cast(member.shape).width]
    system.specials += Instance(NAMES.top, **wires)
    region = SoCRegion(origin=REGISTERS, size=REGISTERS_BYTES, cached=False)
    system.bus.add_slave("splatcore", host, region)
    port = system.sdram.crossbar.get_port(data_width=config.port)
    origin = system.bus.regions[MEMORY].origin
    system.submodules.splatcore_memory = LiteDRAMAXI2Native(memory, port, base_address=origin)


def ulx3s(config: Config, clock_hz: int, baud: int, sdram: str) -> System:
    """The system for a ULX3S with an LFE5U-85F.

    clock_hz: clock of machine and SDRAM
    baud: of the UART
    sdram: the SDRAM chip, by LiteDRAM's name
    """
    platform = radiona_ulx3s.Platform(device="LFE5U-85F", revision="2.0", toolchain="trellis")
    clocks = Ulx3sClocks(platform, clock_hz)
    module = getattr(modules, sdram)(clock_hz, "1:1")
    phy = GENSDRPHY(platform.request("sdram"), clock_hz)
    return System(platform, clocks, phy, module, clock_hz, baud, config)


def simulated(config: Config, clock_hz: int, baud: int, sdram: str) -> System:
    """The same system for simulation: pins for clock, reset and UART, and LiteDRAM's SDRAM model,
    which reports commands that violate its timing."""
    platform = SimPlatform("SIM", SIMULATED_PINS)
    clocks = CRG(platform.request("sys_clk"), platform.request("sys_rst"))
    module = getattr(modules, sdram)(clock_hz, "1:1")
    phy = SDRAMPHYModel(module, data_width=16, clk_freq=clock_hz, verbosity=SDRAM_VERBOSE_STD)
    return System(platform, clocks, phy, module, clock_hz, baud, config)


def check_board(config: Config):
    """Raise InputError for a machine with 64-bit addresses."""
    if window_bits(config):
        raise InputError(f"preset {config.name}: address_bits 64: a board's bus has 32 bits")


def start_of(system: System) -> list[tuple[int, int, float]]:
    """The SDRAM's start-up sequence for a finalized system.

    Returns the host's writes in order: bus address, value, seconds to wait afterwards.
    """
    registers = json.loads(get_csr_json(system.csr_regions))["csr_registers"]
    at = {name.removeprefix("sdram_dfii_"): each["addr"] for name, each in registers.items()}
    sequence, _ = init.get_sdram_phy_init_sequence(*system.settings)
    writes = []
    for _, address, bank, command, cycles in sequence:
        wait = cycles / system.clock_hz
        value = sum(BITS[name.removeprefix("DFII_")] for name in command.split("|"))
        writes += [(at["pi0_address"], address, 0.0), (at["pi0_baddress"], bank, 0.0)]
        if command.startswith("DFII_CONTROL"):
            writes.append((at["control"], value, wait))
        else:
            writes += [(at["pi0_command"], value, 0.0), (at["pi0_command_issue"], 1, wait)]
    return [*writes, (at["control"], BITS["CONTROL_SEL"], 0.0)]
