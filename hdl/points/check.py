"""Checks a frame's registers before the frame begins."""

from amaranth.hdl import Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import frame_layout
from splatcore.spec import work
from splatcore.spec.binning import groups_max
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.registers import ALIGNED, CODE_BITS, DETAIL_BITS, ErrorCode, frame_registers

LATENCY = 2
"""Cycles from the registers to the result."""


class Check(wiring.Component):
    """Checks whether a frame's registers describe a frame that this machine can render.

    It checks the image's size and stride, the alignment of all addresses, and whether everything
    except the model ends within 4 GiB: the table of groups of the largest image, list pages and
    features of both work areas, scratch memory, all rows of the image.

    **Timing**: `LATENCY` cycles. One multiplier of HEIGHT's and STRIDE's bits for the image's end,
    and one of the numbers of groups along both sides.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "frame": In(frame_layout(config)),  # the registers
            "error": Out(CODE_BITS),  # `ErrorCode`, NONE if the frame is valid
            "detail": Out(DETAIL_BITS),  # detail of the error
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        names = [register.name for register in frame_registers(self.config)]
        found = [(ErrorCode.SIZE, number, wrong) for number, wrong in enumerate(self._sizes(m))]
        for code, registers in (
            (ErrorCode.ALIGNMENT, self._unaligned()),
            (ErrorCode.RANGE, self._beyond(m)),
        ):
            found += [(code, names.index(name), wrong) for name, wrong in registers.items()]
        error, detail = Const(ErrorCode.NONE, CODE_BITS), Const(0, DETAIL_BITS)
        for code, number, wrong in reversed(found):
            error, detail = Mux(wrong, code, error), Mux(wrong, number, detail)
        m.d.sync += [self.error.eq(error), self.detail.eq(detail)]
        return m

    def _sizes(self, m: Module) -> list[Value]:
        """Whether width, height and stride are invalid; too many groups count as width."""
        frame, config = self.frame, self.config
        side = exact_log2(TILE * config.group)
        sides = {name: frame[name] for name in ("width", "height")}
        groups = {name: Signal(len(pixels) - side + 1, name=f"{name}_groups", reset_less=True)
                  for name, pixels in sides.items()}  # fmt: skip
        m.d.sync += [groups[name].eq((sides[name] + (1 << side) - 1) >> side) for name in sides]
        wrong = {name: pixels == 0 for name, pixels in sides.items()}
        for name, pixels in sides.items():
            if config.side_max < (1 << len(pixels)) - 1:
                wrong[name] |= pixels > config.side_max
        row = frame.width * work.PIXEL
        if config.rgba:
            row = Mux(frame["format"], frame.width * work.PIXEL_RGBA, row)
        too_many = groups["width"] * groups["height"] > groups_max(config)
        return [
            wrong["width"] | too_many,
            wrong["height"],
            (frame.stride < row) | (frame.stride % work.STRIDE_ALIGNMENT != 0),
        ]

    def _unaligned(self) -> dict[str, Value]:
        """Whether a register's address is not aligned, in the order of `ALIGNED`."""
        return {
            name: self.frame[name.lower()][: exact_log2(bytes_)].any()
            for name, bytes_ in ALIGNED.items()
        }

    def _beyond(self, m: Module) -> dict[str, Value]:
        """Whether the data at a register's address ends beyond the last address."""
        frame, config = self.frame, self.config
        lengths = {
            "GROUPS": Const(work.aligned(groups_max(config) * work.SLOT) // work.WORK_ALIGNMENT),
            "LISTS": units(frame.lists_pages, work.page_bytes(config)),
            "FEATURES": units(frame.features_max, work.FEATURE),
            "SCRATCH": Const(work.scratch_bytes(config) // work.WORK_ALIGNMENT),
        }
        found = {}
        for name, length in lengths.items():
            at = frame[name.lower()][exact_log2(work.WORK_ALIGNMENT) :]
            behind = 0 if name == "SCRATCH" else frame.work_area[exact_log2(work.WORK_ALIGNMENT) :]
            begin = Signal(len(at) + 1, name=f"{name.lower()}_begin", reset_less=True)
            m.d.sync += begin.eq(at + behind)
            found[name] = begin + length > 1 << len(at)
        at = frame.pixels[exact_log2(work.STRIDE_ALIGNMENT) :]
        size = Signal(len(frame.height) + len(frame.stride), reset_less=True)
        m.d.sync += size.eq(frame.height * frame.stride[exact_log2(work.STRIDE_ALIGNMENT) :])
        return found | {"PIXELS": at + size > 1 << len(at)}


def units(count: Value, each: int) -> Value:
    """Number of units of `WORK_ALIGNMENT` for `count` items of `each` bytes.

    each: a divisor or a multiple of `WORK_ALIGNMENT`
    """
    if each >= work.WORK_ALIGNMENT:
        return count << exact_log2(each // work.WORK_ALIGNMENT)
    shift = exact_log2(work.WORK_ALIGNMENT // each)
    return (count + (1 << shift) - 1) >> shift
