"""A unit that does, for each frame it is sent, what a test says, and remembers what it really did."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from rs485bus.sim import SimUnit
from rs485bus.wire.frames import Request, crc
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

    @property
    def is_plain(self) -> bool:
        """It is answered at once, and the answer leaves nothing open."""
        return self.heard and self.answered and self.after is None and self.code in (None, 1, 2, 3, 6)


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
        self.is_plain = True
        """Each frame so far got an answer at once that says what became of it."""

    def receive(self, frame: bytes, now: float) -> bytes | None:
        if frame[0] not in (0, self.address):
            return None
        self.frames.append(frame)
        step = self.script.popleft() if self.script else FINE
        self.is_plain = self.is_plain and step.is_plain
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

    def was_sent(self, request: Request) -> int:
        """How often a frame was sent to it."""
        return self.frames.count(request.adu)

    def times_written(self, register: int, *values: int) -> int:
        """How often a write was really carried out."""
        return sum((at, written) == (register, values) for _, at, written in self.writes)
