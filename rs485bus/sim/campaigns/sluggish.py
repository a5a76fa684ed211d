"""Plain devices beside the drives whose reply times have a heavy tail: 1 ms mostly, 2 s now and then."""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable
from functools import partial

from rs485bus.bus.bus import Bus
from rs485bus.sim.modbus import ModbusData, SimModbus
from rs485bus.sim.treatment import PLAIN, Treatment

Question = Callable[[], Awaitable[object]]
_REGISTERS = 1000
_COUNT = 2
_SHORTEST = 0.001
LONGEST = 2.0
"""Seconds that a reply takes at most."""
_SHAPE = 1.0
"""Of the Pareto distribution: at 1 a reply takes over 0.1 s once in a hundred times, over 1 s once in a thousand."""


class Sluggish:
    """Some of them. No two of their registers hold the same, so that an answer to another question shows.

    Args:
        addresses: theirs.
        seed: makes it reproducible.
    """

    def __init__(self, addresses: range, seed: int) -> None:
        self.devices = [
            SimModbus(address, ModbusData(registers={at: _value(address, at) for at in range(_REGISTERS + _COUNT)}))
            for address in addresses
        ]
        self.wrong: list[str] = []
        """Answers that were not to what was asked."""
        self._addresses = addresses
        self._delays, self._questions = random.Random(seed), random.Random(seed + 1)

    def script(self, frame: bytes, now: float) -> Treatment:
        """How late they answer, for `VirtualPair.script`."""
        if frame[0] not in self._addresses:
            return PLAIN
        return Treatment(delay=min(LONGEST, _SHORTEST * self._delays.paretovariate(_SHAPE)))

    def questions(self, bus: Bus) -> list[Question]:
        """A question to each. Raises what the request does; what is wrong with an answer is added to `wrong`."""
        return [partial(self._ask, bus, address) for address in self._addresses]

    async def _ask(self, bus: Bus, address: int) -> None:
        at = self._questions.randrange(_REGISTERS)
        told = list(await bus.unit(address).read_holding_registers(at, count=_COUNT))
        wanted = [_value(address, at + more) for more in range(_COUNT)]
        if told != wanted:
            self.wrong.append(f"unit {address} was asked for {at} and told {told} instead of {wanted}")


def _value(address: int, register: int) -> int:
    return (address * 2003 + register * 7) & 0xFFFF
