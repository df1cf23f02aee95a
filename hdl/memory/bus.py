"""Signatures of the machine's two AXI ports, seen from the master.

A component's member `m_axi` with this signature has the Verilog ports `m_axi__awid` and so on. AXI
signals that would always be 0 (lock, region, quality of service, user) are left out, and so is
protection, which the register slave does not use.
"""

from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.spec import axi as spec
from splatcore.spec.config import Config

RESPONSE_BITS = 2


def fixed(config: Config) -> dict[str, tuple[int, int]]:
    """Constant signals of an address channel: name without `ar` or `aw` → width and value."""
    return {
        "size": (3, exact_log2(spec.port_bytes(config))),  # whole beats
        "burst": (2, 1),  # INCR
        "cache": (4, 0b0011),  # a memory: bufferable, modifiable, in no cache
        "prot": (3, 0b010),  # data, not privileged, not secure
    }


def axi(config: Config) -> wiring.Signature:
    """Signature of the AXI4 port."""
    wires = {}
    for channel in ("aw", "ar"):
        wires |= {
            f"{channel}id": Out(spec.ID_BITS),
            f"{channel}addr": Out(config.address_bits),
            f"{channel}len": Out(spec.LENGTH_BITS),
        }
        wires |= {f"{channel}{name}": Out(width) for name, (width, _) in fixed(config).items()}
        wires |= {f"{channel}valid": Out(1), f"{channel}ready": In(1)}
    return wiring.Signature(
        wires
        | {"wdata": Out(config.port), "wstrb": Out(config.port // 8), "wlast": Out(1)}
        | {"wvalid": Out(1), "wready": In(1)}
        | {"bid": In(spec.ID_BITS), "bresp": In(RESPONSE_BITS), "bvalid": In(1), "bready": Out(1)}
        | {"rid": In(spec.ID_BITS), "rdata": In(config.port), "rresp": In(RESPONSE_BITS)}
        | {"rlast": In(1), "rvalid": In(1), "rready": Out(1)}
    )


def axi_lite() -> wiring.Signature:
    """Signature of the AXI4-Lite port."""
    wires = {}
    for channel in ("aw", "ar"):
        wires |= {f"{channel}addr": Out(spec.LITE_ADDRESS_BITS)}
        wires |= {f"{channel}valid": Out(1), f"{channel}ready": In(1)}
    return wiring.Signature(
        wires
        | {"wdata": Out(spec.LITE_DATA_BITS), "wstrb": Out(spec.LITE_DATA_BITS // 8)}
        | {"wvalid": Out(1), "wready": In(1)}
        | {"bresp": In(RESPONSE_BITS), "bvalid": In(1), "bready": Out(1)}
        | {"rdata": In(spec.LITE_DATA_BITS), "rresp": In(RESPONSE_BITS)}
        | {"rvalid": In(1), "rready": Out(1)}
    )
