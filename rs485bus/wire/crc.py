"""The CRC that ends every RTU frame: of a frame, and of any part of a stream. Pure.

Source: Modbus over Serial Line V1.02, 6.2.2.
"""

from __future__ import annotations

from array import array
from functools import lru_cache
from struct import unpack_from
from typing import Final

_START: Final = 0xFFFF
_POLYNOMIAL: Final = 0xA001


def _after_zero_bits(state: int) -> int:
    for _ in range(8):
        state = (state >> 1) ^ (_POLYNOMIAL if state & 1 else 0)
    return state


_TABLE: Final = tuple(_after_zero_bits(byte) for byte in range(256))


def _combinations(bits: list[int]) -> list[int]:
    """What becomes of each number, from what becomes of its bits."""
    values = [0]
    for bit in bits:
        values += [value ^ bit for value in values]
    return values


_WORDS: Final = array("H", _combinations([_after_zero_bits(_after_zero_bits(1 << bit)) for bit in range(16)]))
"""What becomes of a state after two more bytes: half as many steps."""


def _state(data: bytes) -> int:
    """The state of the calculation after `data`."""
    words, state, odd = _WORDS, _START, len(data) & 1
    if odd:
        state = (state >> 8) ^ _TABLE[(state ^ data[0]) & 0xFF]
    for word in unpack_from(f"<{len(data) >> 1}H", data, odd):
        state = words[state ^ word]
    return state


def crc(data: bytes) -> bytes:
    """The CRC of `data` in the order of the wire."""
    return _state(data).to_bytes(2, "little")


def ends_in_crc(frame: bytes) -> bool:
    """Whether the last two bytes are the CRC of all others."""
    return _state(frame) == 0


class StreamCrc:
    """Tells of any part of a growing stream whether it ends in its own CRC.

    It looks at each byte once, however many parts are asked for. The state of the calculation after each byte of the
    stream is kept. The calculation is linear: what a state contributes after n more bytes depends on it and on n
    alone. So the state that a part would have by itself follows from the states at its two ends.
    """

    __slots__ = ("_states",)

    def __init__(self) -> None:
        self._states = [_START]

    def restart(self) -> None:
        """Another stream begins."""
        self._states = [_START]

    def extend(self, stream: bytearray) -> None:
        """The stream has grown to this."""
        table, states = _TABLE, self._states
        state = states[-1]
        for byte in stream[len(states) - 1 :]:
            state = (state >> 8) ^ table[(state ^ byte) & 0xFF]
            states.append(state)

    def closes(self, begin: int, end: int) -> bool:
        """Whether the bytes `begin` to `end` of the stream end in their CRC."""
        surplus = self._states[begin] ^ _START
        if surplus:
            low, high = _after_zeros(end - begin)
            surplus = low[surplus & 0xFF] ^ high[surplus >> 8]
        return self._states[end] == surplus

    def drop(self, count: int) -> None:
        """The first bytes of the stream were dropped."""
        del self._states[:count]
        if not self._states:
            self._states.append(_START)


@lru_cache(maxsize=256)
def _after_zeros(count: int) -> tuple[array[int], array[int]]:
    """What becomes of the low and of the high byte of a state after so many zero bytes."""
    bits = [1 << bit for bit in range(16)]
    for _ in range(count):
        bits = [(bit >> 8) ^ _TABLE[bit & 0xFF] for bit in bits]
    return array("H", _combinations(bits[:8])), array("H", _combinations(bits[8:]))
