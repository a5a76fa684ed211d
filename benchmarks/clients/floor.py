"""The floor: a bare client. Its frames are made beforehand, it reads and writes the port directly, believes every
reply of the right length, and spins to the end of the silence. No library can do with less; it is none.
"""

from __future__ import annotations

import os
import time
import tty
from collections.abc import Sequence

from rs485bus.wire.frames import read_holding, write_multiple
from rs485bus.wire.timing import LineSettings


class Client:
    def open(self, port: str, baudrate: int, timeout: float) -> None:
        self._fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._fd)
        self._silence = LineSettings(baudrate=baudrate).t35
        self._quiet_at = 0.0
        self._frames: dict[tuple[int, int], tuple[bytes, int]] = {}

    def read(self, unit: int, register: int, count: int) -> Sequence[int]:
        made = self._frames.get((unit, 3))
        if made is None:
            request = read_holding(unit, register, count)
            made = self._frames[unit, 3] = (request.adu, request.length)
        self._exchange(*made)
        return ()

    def write(self, unit: int, register: int, values: Sequence[int]) -> None:
        made = self._frames.get((unit, 16))
        if made is None:
            request = write_multiple(unit, register, values)
            made = self._frames[unit, 16] = (request.adu, request.length)
        self._exchange(*made)

    def close(self) -> None:
        os.close(self._fd)

    def _exchange(self, frame: bytes, length: int) -> None:
        clock, quiet_at, fd = time.monotonic, self._quiet_at, self._fd
        while clock() < quiet_at:
            pass
        os.write(fd, frame)
        received = len(os.read(fd, 256))
        while received < length:
            received += len(os.read(fd, 256))
        self._quiet_at = clock() + self._silence
