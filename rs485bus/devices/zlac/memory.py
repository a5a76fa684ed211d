"""What the registers of a ZLAC8015D hold, as far as its replies have told, whoever asked or wrote. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from rs485bus.motion.standstill import NEVER
from rs485bus.wire.answers import READ_HOLDING, WRITE_MULTIPLE, WRITE_SINGLE
from rs485bus.wire.frames import Request, payload
from rs485bus.wire.registers import Register

T = TypeVar("T")


def words_from(first: int, data: bytes) -> dict[int, int]:
    """Data as registers, by address, from the first one's on."""
    return {first + at // 2: int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data) - 1, 2)}


def read_words(request: Request, reply: bytes) -> dict[int, int]:
    """The registers that the reply to a read tells, by address."""
    return words_from(request.register, payload(reply)) if request.function == READ_HOLDING else {}


def written_words(request: Request) -> dict[int, int]:
    """What a plain write says to its registers, by address."""
    if request.function == WRITE_SINGLE:
        return words_from(request.register, request.adu[4:6])
    if request.function == WRITE_MULTIPLE:
        return words_from(request.register, request.adu[7:-2])
    return {}


def decode(what: Register[T], words: Mapping[int, int]) -> T | None:
    """The value of a register; None if not all of its words are there, or they say what no manual names."""
    try:
        return what.decode(b"".join(words[what.address + at].to_bytes(2, "big") for at in range(what.count)))
    except (KeyError, ValueError):
        return None


class ZlacMemory:
    """What one drive holds. A write makes unknown what it may change, until it is acknowledged or read."""

    def __init__(self) -> None:
        self._words: dict[int, int] = {}
        self._sent: dict[int, tuple[float, bytes]] = {}
        """The last write to each address: when, and its frame."""
        self._said: dict[int, int] = {}
        """The last word that was written to each address, whether or not that was acknowledged."""

    def forget(self) -> None:
        """It may hold anything: it has restarted."""
        self._words.clear()
        self._said.clear()

    def sent(self, request: Request, at: float) -> None:
        """A write goes out."""
        for address, word in written_words(request).items():
            self._words.pop(address, None)
            self._sent[address], self._said[address] = (at, request.adu), word

    def heard(self, request: Request, reply: bytes, asked_at: float) -> None:
        """It answered something that was asked for at a time or later."""
        if request.writes:
            told = {
                address: word
                for address, word in written_words(request).items()
                if self._sent.get(address, (NEVER, b""))[1] == request.adu
            }
        else:
            told = {
                address: word
                for address, word in read_words(request, reply).items()
                if asked_at >= self._sent.get(address, (NEVER, b""))[0]
            }
        self._words.update(told)

    def value(self, register: Register[T]) -> T | None:
        """What a register holds; None if that is not known."""
        return decode(register, self._words)

    def told(self, register: Register[T]) -> T | None:
        """What a register holds or, where that is not known, what it was told last: that may have arrived."""
        held = self.value(register)
        return decode(register, self._said) if held is None else held
