"""The host's side of a board: a model into its memory, a frame, the picture out of it.

Words of 32 bits on the board's bus are written and read by UARTBone, LiteX's own protocol.
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

from splatcore.sim.board.memory import place_in
from splatcore.sim.board.write import FACTS, PRESET
from splatcore.sim.machine.machine import Job, frame_values
from splatcore.spec import registers
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from splatcore.spec.registers import WORD, ErrorCode
from splatcore.spec.work import PIXEL, stride

ANSWER_SECONDS = 5.0
"""A board that has not answered for so long is not there."""

FRAME_SECONDS = 60.0
"""A frame that is not complete then is given up."""

BROKEN_OFF_SECONDS = 0.2
"""A command that an earlier host broke off is forgotten by the board's bus bridge within this."""

WRITE_WORDS, READ_WORDS = 256, 128  # of memory, until progress is told again; 255 are one read

FACTS_OF_A_BOARD = {"preset", "clock_hz", "baud", "registers", "memory", "start"}


def read_board(folder: str) -> tuple[Config, dict[str, Any]]:
    """The machine and the facts of a folder that `board write` has written; InputError for another
    one."""
    path = Path(folder) / FACTS
    try:
        facts = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from None
    if not isinstance(facts, dict) or not facts.keys() >= FACTS_OF_A_BOARD:
        raise InputError(f"{path}: is no board's; `board write` writes one")
    own = facts["preset"] == PRESET
    return find_preset(str(path.with_name(PRESET)) if own else facts["preset"]), facts


@dataclass(frozen=True)
class Frame:
    """A picture from a board, [H, W, 3] uint8, and the cycles of both halves."""

    pixels: np.ndarray
    preprocessing: int
    rendering: int


class Host(CommUART):
    """A board on a serial port. facts: those of its `board.json`.

    InputError, naming the port, if it cannot be opened, and if nothing answers.
    """

    def __init__(self, port: str, config: Config, facts: dict[str, Any]):
        self.name, self.config, self.facts = port, config, facts
        self.at = {
            name: facts["registers"] + offset
            for name, offset in registers.addresses(config).items()
        }
        try:
            super().__init__(port, facts["baud"])
        except (OSError, ValueError) as error:  # pyserial's own is one of the former
            raise InputError(f"{port}: {error}") from None
        self.port.timeout = ANSWER_SECONDS

    def _read(self, length: int) -> bytes:
        with self._told():
            found = self.port.read(length)
        if len(found) < length:
            raise InputError(f"{self.name}: the board does not answer")
        return found

    def _write(self, data: bytes | list[int]):
        with self._told():
            super()._write(data)

    def _flush(self):
        with self._told():
            super()._flush()

    @contextmanager
    def _told(self) -> Iterator[None]:
        """A port that is gone is an InputError."""
        try:
            yield
        except OSError as error:
            raise InputError(f"{self.name}: {error}") from None

    def get(self, name: str) -> int:
        """A register of the machine."""
        return self.read(self.at[name])

    def put(self, name: str, value: int):
        """Write a register of the machine."""
        self.write(self.at[name], value)

    def begin(self):
        """Have the SDRAM work, and the machine stand still; InputError if it is not the one that is
        expected."""
        time.sleep(BROKEN_OFF_SECONDS)
        for address, value, seconds in self.facts["start"]:
            self.write(address, value)
            time.sleep(seconds)
        known = {each.name: each.value for each in registers.control_registers(self.config)}
        for name in ("ID", "VERSION", "PICTURE_MAX"):
            if (found := self.get(name)) != known[name]:
                text = f"{name} is {found:#x}, of preset {self.config.name} {known[name]:#x}"
                raise InputError(f"{self.name}: {text}")
        self.put("CONTROL", registers.ABORT)
        self._until(lambda: self.get("STATUS") == registers.READY, "does not come to rest")

    def load(self, address: int, content: np.ndarray, tell: Callable[[int, int], None]):
        """Write bytes into memory. tell: progress, of bytes and of all there are."""
        padded = np.pad(content, (0, -len(content) % WORD))
        words = padded.view("<u4").tolist()
        for k in range(0, len(words), WRITE_WORDS):
            self.write(address + WORD * k, words[k : k + WRITE_WORDS])
            tell(WORD * k, len(padded))

    def fetch(self, address: int, size: int, tell: Callable[[int, int], None]) -> np.ndarray:
        """Bytes of memory, a whole number of words."""
        words: list[int] = []
        while (left := size // WORD - len(words)) > 0:
            words += self.read(address + WORD * len(words), min(left, READ_WORDS))
            tell(WORD * len(words), size)
        return np.array(words, "<u4").view(np.uint8)

    def frame(self, job: Job, tell: Callable[[int, int | None, str], None]) -> Frame:
        """Render a frame. tell: progress, bytes and of how many, and of what.

        InputError says what the machine tells, or that it does not come to an end.
        """
        memory, camera = self.facts["memory"], job.camera
        areas = place_in(self.config, job.model, camera, memory["at"], memory["bytes"])

        def telling(label: str) -> Callable[[int, int], None]:
            return lambda done, total: tell(done, total, label)

        self.load(areas.models[0], job.model.image, telling("loading the model"))
        for name, value in frame_values(self.config, job, 0, areas, 0).items():
            self.put(name, value)
        tell(0, None, "rendering")
        self._run()
        row, height = stride(camera.width), camera.height
        rows = self.fetch(areas.images[0], row * height, telling("fetching the picture"))
        pixels = rows.reshape(height, row)[:, : camera.width * PIXEL]
        cycles = [self.get(f"{half}_CYCLES") for half in ("PREPROCESSING", "RENDERING")]
        return Frame(pixels.reshape(height, camera.width, PIXEL), *cycles)

    def _run(self):
        """START, and wait for the frame's end."""
        self.put("ERROR", 0)
        self.put("INTERRUPT", self.get("INTERRUPT"))
        self.put("CONTROL", registers.START)
        try:
            self._until(self._ended, "no frame")
        except InputError:
            self.put("CONTROL", registers.ABORT)
            raise

    def _until(self, done: Callable[[], bool], failed: str):
        """Wait; InputError, with what has failed, if it takes too long."""
        end = time.monotonic() + FRAME_SECONDS
        while not done():
            if time.monotonic() > end:
                raise InputError(f"{self.name}: {failed} within {FRAME_SECONDS:g} s")

    def _ended(self) -> bool:
        """A frame is complete; InputError, with what the machine tells, if it is given up."""
        events = self.get("INTERRUPT")
        if events & registers.INTERRUPT_ERROR:
            raise InputError(f"{self.name}: {self._error()}")
        return bool(events & registers.INTERRUPT_FRAME)

    def _error(self) -> str:
        """What the machine says in ERROR, in words."""
        code, detail, _ = registers.split_error(self.get("ERROR"))
        more = f", the lists need {self.get('NEEDED')} pages" if code == ErrorCode.PAGES else ""
        return f"ERROR {code.name}, detail {detail}{more}"
