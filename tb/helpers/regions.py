"""Memory of regions for cocotbext-axi's `AxiSlave`: it refuses accesses that no region allows.

The library's `AxiRam` reduces addresses modulo its size, so a wrong upper bit has no effect there.
"""

from cocotb.triggers import Event


class Regions:
    """Bytes from address 0 to the end of the last region.

    regions: (begin, end, writable) of each region, addresses in bytes
    A refused access, answered by SLVERR, ends the test if `watch` runs.
    """

    def __init__(self, regions: list[tuple[int, int, bool]]):
        self.bytes, self.regions = bytearray(max(end for _, end, _ in regions)), regions
        self.refused, self.message = Event(), ""

    def put(self, address: int, data: bytes):
        """Change bytes, also of read-only regions."""
        self.bytes[address : address + len(data)] = data

    def get(self, address: int, length: int) -> bytes:
        return bytes(self.bytes[address : address + length])

    async def write(self, address: int, data: bytes):
        """Called by `AxiSlave`."""
        self._check("write", address, len(data), writes=True)
        self.put(address, data)

    async def read(self, address: int, length: int) -> bytes:
        """Called by `AxiSlave`."""
        self._check("read", address, length, writes=False)
        return self.get(address, length)

    async def watch(self):
        """AssertionError at the first refused access."""
        await self.refused.wait()
        raise AssertionError(self.message)

    def _check(self, way: str, address: int, length: int, writes: bool):
        end = address + length
        for first, last, writable in self.regions:
            if first <= address and end <= last and (writable or not writes):
                return
        if not self.message:
            self.message = f"no region allows a {way} of {length} bytes at {address:#x}"
        self.refused.set()
        raise ValueError(self.message)
