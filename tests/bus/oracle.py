"""A unit that does, for each frame it is sent, what a test says, and remembers what it really did."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from rs485bus.sim import SimUnit
from rs485bus.wire.frames import crc
from tests.bus.support import BANK


class Step(NamedTuple):
    """What becomes of one frame."""

    heard: bool = True
    """It reaches the unit."""
    done: bool = True
    """The unit carries it out."""
    code: int | None = None
    """The exception that answers it; None for the normal reply."""
    answered: bool = True
    """The answer reaches the master."""
    after: float | None = None
    """Seconds before the answer; None for as long as usual."""


FINE = Step()
DEAF = Step(heard=False)
LOST = Step(answered=False)


def late(after: float) -> Step:
    """It is done, and answered so many seconds later."""
    return Step(after=after)


def refuses(code: int) -> Step:
    """It is not done, and answered by an exception."""
    return Step(done=False, code=code)


def does_and_says(code: int, after: float | None = None) -> Step:
    """It is done, and answered by an exception."""
    return Step(code=code, after=after)


class Oracle(SimUnit):
    """Follows a script, and answers normally when that is used up. `writes` holds what it really did."""

    def __init__(self, address: int, *script: Step) -> None:
        super().__init__(address, BANK)
        self.script = deque(script)
        self.frames: list[bytes] = []
        """What was sent to it, heard or not."""

    def receive(self, frame: bytes, now: float) -> bytes | None:
        if frame[0] not in (0, self.address):
            return None
        self.frames.append(frame)
        step = self.script.popleft() if self.script else FINE
        if not step.heard:
            return None
        self.turnaround = step.after
        reply = super().receive(frame, now) if step.done else None
        if not step.answered:
            return None
        if step.code is None:
            return reply
        body = bytes((self.address, frame[1] | 0x80, step.code))
        return body + crc(body)

    def times_written(self, register: int, *values: int) -> int:
        """How often a write was really carried out."""
        return sum((at, written) == (register, values) for _, at, written in self.writes)
