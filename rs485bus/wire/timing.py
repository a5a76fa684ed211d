"""How long bytes take on the pair: characters, silences, airtime, reply budgets.

Source: Modbus over Serial Line V1.02, 2.5.1.1 (t1.5, t3.5).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from rs485bus.arguments import whole

Parity = Literal["N", "E", "O"]

# Above this rate the specification fixes the silences, so that fast lines do not ask for impossible timers.
_FIXED_ABOVE = 19200
_FIXED_T15 = 0.000_75
_FIXED_T35 = 0.001_75
# Below it a silence counts characters of 11 bits, whatever the line is set to.
_SPECIFIED_BITS = 11


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSettings:
    """How characters travel on one pair.

    Args:
        baudrate: bits per second, 300 to 4,000,000.
        parity: "N", "E" or "O".
        stopbits: 1 or 2.

    Raises:
        ValueError: a setting out of range.
    """

    baudrate: int
    parity: Parity = "N"
    stopbits: Literal[1, 2] = 1
    character: float = field(init=False)
    """Seconds one character takes: start bit, eight data bits, parity and stop bits."""
    t15: float = field(init=False)
    """The silence, in seconds, that may not occur within a frame."""
    t35: float = field(init=False)
    """The silence, in seconds, that must stand between two frames."""

    def __post_init__(self) -> None:
        whole("baudrate", self.baudrate, 300, 4_000_000)
        if self.parity not in ("N", "E", "O"):
            raise ValueError(f"parity {self.parity!r} is none of 'N' (none), 'E' (even), 'O' (odd)")
        if self.stopbits not in (1, 2):
            raise ValueError(f"stopbits {self.stopbits!r} is neither 1 nor 2")
        bits = 1 + 8 + (self.parity != "N") + self.stopbits
        fast = self.baudrate > _FIXED_ABOVE
        specified = _SPECIFIED_BITS / self.baudrate
        object.__setattr__(self, "character", bits / self.baudrate)
        object.__setattr__(self, "t15", _FIXED_T15 if fast else 1.5 * specified)
        object.__setattr__(self, "t35", _FIXED_T35 if fast else 3.5 * specified)

    @property
    def shortest_silence(self) -> float:
        """1.5 characters, in seconds: a shorter silence may occur within a frame, whatever the devices take."""
        return 1.5 * _SPECIFIED_BITS / self.baudrate

    def airtime(self, length: int) -> float:
        """Seconds that `length` bytes occupy the pair."""
        return length * self.character

    def budget(self, request: int, turnaround: float, reply: int) -> float:
        """Seconds from the first bit of a request of `request` bytes to the last of its reply.

        Args:
            request: bytes of the request.
            turnaround: seconds the device may take before it starts to answer.
            reply: bytes of the reply.
        """
        return (request + reply) * self.character + turnaround
