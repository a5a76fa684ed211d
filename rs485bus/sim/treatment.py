"""What becomes of one frame on a virtual pair: whoever writes a script of faults says it frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rs485bus.sim.device import SimDevice

Happening = Callable[[SimDevice, float], None]
"""Something that happens to the device that is asked, at a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Treatment:
    """What becomes of one frame and of its reply."""

    heard: bool = True
    """It reaches the device."""
    carried_out: bool = True
    """The device does what it is asked."""
    code: int | None = None
    """The exception that it answers; None for its own answer."""
    answered: bool = True
    """The reply reaches the master."""
    delay: float = 0.0
    """Seconds by which the reply is later than usual. What the device is asked meanwhile it answers after that."""
    copies: int = 1
    """How often the reply comes."""
    damaged: bool = False
    """A bit of the reply arrives inverted."""
    torn: bool = False
    """Only the first half of the reply arrives."""
    before: Happening | None = None
    """Happens to the device right before it hears the frame."""
    after: Happening | None = None
    """Happens to the device right after it began to answer."""

    def of_reply(self, reply: bytes) -> bytes:
        """What of a reply arrives."""
        if self.damaged:
            middle = len(reply) // 2
            reply = reply[:middle] + bytes([reply[middle] ^ 0x10]) + reply[middle + 1 :]
        if self.torn:
            reply = reply[: len(reply) // 2]
        return reply * self.copies


PLAIN = Treatment()
"""Nothing goes wrong."""
