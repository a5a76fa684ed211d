"""What a virtual TL-R drive is set to: words that are legal, and those of them that it keeps when switched off."""

from __future__ import annotations

from typing import Any, TypeVar

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.values import BaudRate, DiFunction, DoFunction, HomingMode, OperatingMode
from rs485bus.errors import LimitExceeded
from rs485bus.sim.device import ILLEGAL_ADDRESS, ILLEGAL_VALUE, Refusal
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")

_WRITABLE: dict[int, Register[Any]] = {
    register.address + offset: register
    for register in (*r.COMMANDS, *r.SETTINGS, *r.MANUFACTURER)
    for offset in range(register.count)
}


class Memory:
    """The registers that can be written.

    Args:
        subdivision: pulses a turn.
        station: what PA_020 holds.
        operating_mode: how the motor is driven.
    """

    def __init__(self, subdivision: int, station: int, operating_mode: OperatingMode) -> None:
        self._factory = _factory(subdivision, operating_mode)
        self.words = dict(self._factory)
        """What holds now."""
        self.set(r.STATION, station)
        self.saved = dict(self.words)
        """What holds after it was switched off and on."""

    def get(self, register: Register[T]) -> T:
        """A typed value."""
        return register.decode(self._bytes(register.address, register.count))

    def block(self, block: Block) -> tuple[Any, ...]:
        """The typed values of a block."""
        return block.decode(self._bytes(block.address, block.count))

    def set(self, register: Register[T], value: T) -> None:
        """Set a value, as somebody at its debugging software would."""
        data = register.encode(value)
        for at in range(register.count):
            self.words[register.address + at] = int.from_bytes(data[2 * at : 2 * at + 2], "big")

    def check(self, first: int, values: tuple[int, ...]) -> None:
        """Raise `Refusal` for a write that is not allowed. Halves of 32-bit values are what they are."""
        for address, value in enumerate(values, first):
            register = _WRITABLE.get(address)
            if register is None:
                raise Refusal(ILLEGAL_ADDRESS)
            if register.count == 1:
                try:
                    register.encode(register.decode(value.to_bytes(2, "big")))
                except (LimitExceeded, ValueError):
                    raise Refusal(ILLEGAL_VALUE) from None

    def save(self) -> None:
        """Keep what holds now."""
        self.saved = dict(self.words)

    def reset(self) -> None:
        """As it left the factory."""
        self.words = dict(self._factory)
        self.save()

    def restart(self) -> None:
        """What was not saved is gone; commands are."""
        self.words = dict(self.saved)
        for register in r.COMMANDS:
            self.words[register.address] = 0

    def _bytes(self, first: int, count: int) -> bytes:
        return b"".join(self.words[address].to_bytes(2, "big") for address in range(first, first + count))


def _factory(subdivision: int, operating_mode: OperatingMode) -> dict[int, int]:
    """The defaults of 2.2.2 and 3.2.2; of the rest the manual prints none."""
    defaults: dict[Register[Any], Any] = {
        r.INPUT_FUNCTIONS[0]: DiFunction.ORIGIN,
        r.INPUT_FUNCTIONS[1]: DiFunction.POSITIVE_LIMIT,
        r.INPUT_FUNCTIONS[2]: DiFunction.NEGATIVE_LIMIT,
        r.INPUT_FILTER: 2,
        r.OUTPUT_FUNCTIONS[0]: DoFunction.ALARM,
        r.STATION: 1,
        r.SUBDIVISION: subdivision,
        r.BAUD_RATE: BaudRate.BAUD_115200,
        r.JOG_SPEED: 60,
        r.JOG_UP: 100,
        r.JOG_DOWN: 100,
        r.START_SPEED: 5,
        r.MOVE_UP: 100,
        r.MOVE_DOWN: 100,
        r.MOVE_SPEED: 60,
        r.HOMING_MODE: HomingMode.POSITIVE_ORIGIN,
        r.HOMING_SPEED: 60,
        r.HOMING_CREEP: 20,
        r.HOMING_RAMP: 100,
        r.OPERATING_MODE: operating_mode,
        r.ENCODER_RESOLUTION: 1000,
        r.MAX_CURRENT: 4000,
    }
    words = dict.fromkeys(_WRITABLE, 0)
    for register, value in defaults.items():
        data = register.encode(value)
        for at in range(register.count):
            words[register.address + at] = int.from_bytes(data[2 * at : 2 * at + 2], "big")
    return words
