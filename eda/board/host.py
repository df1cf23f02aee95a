"""Host of a board: load a model into its memory, render a frame, fetch the picture.

The host writes and reads 32-bit words on the board's bus by UARTBone, LiteX's own protocol.
"""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from litex.tools.remote.comm_uart import CommUART

from splatcore.eda.board.write import FACTS, PRESET
from splatcore.sim.machine.areas import Areas
from splatcore.sim.machine.machine import Job, frame_values
from splatcore.spec import registers
from splatcore.spec.binning import PAGE_BITS
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.preset import find_preset
from splatcore.spec.registers import WORD, ErrorCode, address_values
from splatcore.spec.work import aligned, page_bytes, scratch_bytes, stride, work

MIB = 1 << 20


def place_in(config: Config, model: PackedModel, camera: Camera, at: int, size: int) -> Areas:
    """Place the areas for one frame at a time in a board's memory.

    at, size: address and bytes of the memory
    List pages get the rest of the memory. Raises InputError if not one page fits.
    """
    features = max(1, len(model))
    scratch = at + aligned(len(model.image))
    image = scratch + aligned(scratch_bytes(config))
    groups = image + aligned(stride(camera.width, config.rgba) * camera.height)
    left = at + size - groups - work(config, 0, features).size
    pages = min(left // page_bytes(config), (1 << PAGE_BITS) - 1)
    if pages < 1:
        need = (size - left) / MIB
        text = f"{len(model)} Gaussians at {camera.width}x{camera.height} take {need:.1f} MiB"
        raise InputError(f"{text} and lists; the board has {size / MIB:g} MiB")
    offsets = work(config, pages, features)
    values = {"WORK_AREA": 0, "LISTS_PAGES": pages, "FEATURES_MAX": features}
    for name, begin in (
        ("GROUPS", groups),
        ("LISTS", groups + offsets.lists),
        ("FEATURES", groups + offsets.features),
        ("SCRATCH", scratch),
    ):
        values |= address_values(config, name, begin)
    return Areas((at,), pages, features, (values,), (image,), (), groups + offsets.size)


ANSWER_SECONDS = 5.0
"""Time limit for an answer of the board."""

FRAME_SECONDS = 60.0
"""Time limit for a frame; then it is aborted."""

BROKEN_OFF_SECONDS = 0.2
"""Time after which the board's bus bridge drops a command that an earlier host left unfinished."""

WRITE_WORDS, READ_WORDS = 256, 128  # memory words per progress report; one read has at most 255

FACTS_OF_A_BOARD = {"preset", "clock_hz", "baud", "registers", "memory", "start"}


def read_board(folder: str) -> tuple[Config, dict[str, Any]]:
    """Read a folder written by `board write`.

    Returns the machine and the contents of its `board.json`. Raises InputError for another folder.
    """
    path = Path(folder) / FACTS
    try:
        facts = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from None
    if not isinstance(facts, dict) or not facts.keys() >= FACTS_OF_A_BOARD:
        raise InputError(f"{path}: not a board's file; `board write` creates one")
    own = facts["preset"] == PRESET
    return find_preset(str(path.with_name(PRESET)) if own else facts["preset"]), facts


@dataclass(frozen=True)
class Frame:
    """A rendered frame: pixels as in `Job.pixels`, and the cycles of both halves."""

    pixels: np.ndarray
    preprocessing: int
    rendering: int


class Host(CommUART):
    """A board on a serial port.

    port: name of the serial port
    config: the machine on the board
    facts: contents of its `board.json`
    Raises InputError with the port's name if the port does not open or the board does not answer.
    """

    def __init__(self, port: str, config: Config, facts: dict[str, Any]):
        self.name, self.config, self.facts = port, config, facts
        self.at = {
            name: facts["registers"] + offset
            for name, offset in registers.addresses(config).items()
        }
        try:
            super().__init__(port, facts["baud"])
        except (OSError, ValueError) as error:  # pyserial's SerialException is an OSError
            raise InputError(f"{port}: {error}") from None
        self.port.timeout = ANSWER_SECONDS

    def _read(self, length: int) -> bytes:
        with self._port_errors():
            found = self.port.read(length)
        if len(found) < length:
            raise InputError(f"{self.name}: the board does not answer")
        return found

    def _write(self, data: bytes | list[int]):
        with self._port_errors():
            super()._write(data)

    def _flush(self):
        with self._port_errors():
            super()._flush()

    @contextmanager
    def _port_errors(self) -> Iterator[None]:
        """Turn an OSError of the port into an InputError."""
        try:
            yield
        except OSError as error:
            raise InputError(f"{self.name}: {error}") from None

    def get(self, name: str) -> int:
        """Read a register of the machine."""
        return self.read(self.at[name])

    def put(self, name: str, value: int):
        """Write a register of the machine."""
        self.write(self.at[name], value)

    def begin(self):
        """Start the SDRAM and abort the machine's frames; InputError for another machine."""
        time.sleep(BROKEN_OFF_SECONDS)
        for address, value, seconds in self.facts["start"]:
            self.write(address, value)
            time.sleep(seconds)
        known = {each.name: each.value for each in registers.control_registers(self.config)}
        for name in ("ID", "VERSION", "PICTURE_MAX"):
            if (found := self.get(name)) != known[name]:
                text = f"{name} is {found:#x}; preset {self.config.name} has {known[name]:#x}"
                raise InputError(f"{self.name}: {text}")
        self.put("CONTROL", registers.ABORT)
        self._until(lambda: self.get("STATUS") == registers.READY, "machine not ready")

    def load(self, address: int, content: np.ndarray, progress: Callable[[int, int], None]):
        """Write bytes into memory; progress: called with bytes done and bytes in all."""
        padded = np.pad(content, (0, -len(content) % WORD))
        words = padded.view("<u4").tolist()
        for k in range(0, len(words), WRITE_WORDS):
            self.write(address + WORD * k, words[k : k + WRITE_WORDS])
            progress(WORD * k, len(padded))

    def fetch(self, address: int, size: int, progress: Callable[[int, int], None]) -> np.ndarray:
        """Read `size` bytes of memory, a whole number of words; progress as in `load`."""
        words: list[int] = []
        while (left := size // WORD - len(words)) > 0:
            words += self.read(address + WORD * len(words), min(left, READ_WORDS))
            progress(WORD * len(words), size)
        return np.array(words, "<u4").view(np.uint8)

    def frame(self, job: Job, progress: Callable[[int, int | None, str], None]) -> Frame:
        """Render a frame.

        progress: called with bytes done, bytes in all (None: unknown) and the current step
        Raises InputError with the machine's error, or if the frame takes too long.
        """
        memory, camera = self.facts["memory"], job.camera
        areas = place_in(self.config, job.model, camera, memory["at"], memory["bytes"])

        def labelled(label: str) -> Callable[[int, int], None]:
            return lambda done, total: progress(done, total, label)

        self.load(areas.models[0], job.model.image, labelled("loading the model"))
        for name, value in frame_values(self.config, job, 0, areas, 0).items():
            self.put(name, value)
        progress(0, None, "rendering")
        self._run()
        size = stride(camera.width, job.rgba) * camera.height
        image = self.fetch(areas.images[0], size, labelled("fetching the picture"))
        cycles = [self.get(f"{half}_CYCLES") for half in ("PREPROCESSING", "RENDERING")]
        return Frame(job.pixels(image), *cycles)

    def _run(self):
        """Start a frame and wait for its end; abort it on an error."""
        self.put("ERROR", 0)
        self.put("INTERRUPT", self.get("INTERRUPT"))
        self.put("CONTROL", registers.START)
        try:
            self._until(self._ended, "no frame")
        except InputError:
            self.put("CONTROL", registers.ABORT)
            raise

    def _until(self, done: Callable[[], bool], failed: str):
        """Wait until `done()`; raise InputError with `failed` after FRAME_SECONDS."""
        end = time.monotonic() + FRAME_SECONDS
        while not done():
            if time.monotonic() > end:
                raise InputError(f"{self.name}: {failed} within {FRAME_SECONDS:g} s")

    def _ended(self) -> bool:
        """Whether the frame is complete; InputError with the machine's error if it failed."""
        events = self.get("INTERRUPT")
        if events & registers.INTERRUPT_ERROR:
            raise InputError(f"{self.name}: {self._error()}")
        return bool(events & registers.INTERRUPT_FRAME)

    def _error(self) -> str:
        """ERROR as text."""
        code, detail, _ = registers.split_error(self.get("ERROR"))
        more = f", the lists need {self.get('NEEDED')} pages" if code == ErrorCode.PAGES else ""
        return f"ERROR {code.name}, detail {detail}{more}"
