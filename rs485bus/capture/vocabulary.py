"""What the registers of a drive are called, and what stands in them. Pure; by the tables of the families."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, NamedTuple, Protocol

from rs485bus.capture.pdu import Spoken
from rs485bus.devices.mks import registers as mks
from rs485bus.devices.tlr import registers as tlr
from rs485bus.devices.tlr.values import ControlWord as TlrControl
from rs485bus.devices.zlac import registers as zlac
from rs485bus.devices.zlac.values import ControlWord as ZlacControl
from rs485bus.wire.registers import Block, Field, Register


class Value(NamedTuple):
    """A register or field by its name, with what stands in it."""

    name: str
    value: Any
    """The typed value, in `unit`; None where no bytes were at hand."""
    unit: str

    def __str__(self) -> str:
        return self.name if self.value is None else f"{self.name} {said(self.value, self.unit)}"


class Vocabulary(Protocol):
    """The registers of one family."""

    family: str
    refused_stop: str
    """What it means that a drive refuses a stop; empty where that is an error."""

    def names(self, spoken: Spoken, data: bytes) -> list[Value] | None:
        """What is read or written, with the values in `data` as far as they go; None where it is none of its words."""

    def is_stop(self, spoken: Spoken) -> bool:
        """Whether a write stops the drive."""

    def is_telling(self, spoken: Spoken) -> bool:
        """Whether hardly any other device would be sent this."""


def said(value: Any, unit: str) -> str:
    """A value as people write it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, enum.Flag):
        names = [str(member.name).lower().replace("_", " ") for member in value]
        return "+".join(names) if names else "none"
    if isinstance(value, enum.IntEnum) and value.name not in type(value).__members__:
        return int(value).to_bytes(2, "big").hex(" ").upper()  # it is in no manual
    if isinstance(value, enum.Enum):
        return str(value.name).lower().replace("_", " ")
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    number = f"{value:.6g}" if isinstance(value, float) else str(value)
    return f"{number} {unit}" if unit else number


def _value(field: Field[Any], data: bytes) -> Value:
    if len(data) < field.number.size:
        return Value(field.name, None, field.unit)
    try:
        return Value(field.name, field.decode(data), field.unit)
    except ValueError:  # none of those that the manual names
        return Value(field.name, data[: field.number.size], "")


def _fields(what: Register[Any] | Block, data: bytes) -> list[Value]:
    """The fields of a register or a block."""
    if isinstance(what, Register):
        return [_value(what, data)]
    if not data:
        return [Value(what.name, None, "")]
    values, at = [], 0
    for field in what.fields:
        values.append(_value(field, data[at:]))
        at += field.number.size
    return values


class _MksCodes:
    """Registers that are command codes: each is known by its address and count alone."""

    family = "MKS"
    refused_stop = "it was not moving"
    _reads: Final[dict[tuple[int, int], Register[Any] | Block]] = {
        (what.address, what.count): what for what in mks.READS
    }
    _writes: Final[dict[tuple[int, int], Register[Any] | Block]] = {
        (what.address, what.count): what for what in (*mks.SINGLE_WRITES, *mks.BLOCK_WRITES)
    }

    def names(self, spoken: Spoken, data: bytes) -> list[Value] | None:
        what: Register[Any] | Block | None = None
        if spoken.function == 4:
            what = self._reads.get((spoken.register, spoken.count))
        elif spoken.function in (6, 16):
            what = self._writes.get((spoken.register, spoken.count))
        if what is None:
            return None
        values = _fields(what, data)
        many = isinstance(what, Block) and bool(data)
        return [Value(what.name, None, ""), *values] if many else values

    def is_stop(self, spoken: Spoken) -> bool:
        if spoken.register == mks.EMERGENCY_STOP.address:
            return spoken.function == 6
        # A motion at speed 0 stops; the speed is the second word of each.
        return spoken.function == 16 and spoken.register in _MKS_MOVES and spoken.data[2:4] == b"\0\0"

    def is_telling(self, spoken: Spoken) -> bool:
        known = self.names(spoken, b"") is not None
        return known and (spoken.function == 4 or spoken.register in (*_MKS_MOVES, mks.ENABLE.address))


_MKS_MOVES: Final = frozenset(
    what.address for what in (mks.RUN, mks.MOVE_PULSES, mks.MOVE_TO_PULSES, mks.MOVE_COUNTS, mks.MOVE_TO_COUNTS)
)


class _Memory:
    """Registers that lie side by side, and are read and written in any window (ZLAC, TL-R)."""

    refused_stop = ""

    def __init__(
        self,
        family: str,
        registers: Mapping[int, Register[Any]],
        telling: range,
        control: Register[Any],
        stop_words: frozenset[int],
        speeds: frozenset[int] = frozenset(),
    ) -> None:
        self.family = family
        self._registers = registers
        self._telling = telling
        self._control = control.address
        self._stop_words = stop_words
        self._speeds = speeds

    def names(self, spoken: Spoken, data: bytes) -> list[Value] | None:
        if spoken.function not in (3, 6, 16):
            return None
        window = range(spoken.register, spoken.register + spoken.count)
        if not any(register in self._registers for register in window):
            return None
        return list(self._walk(spoken.register, spoken.count, data))

    def _walk(self, register: int, count: int, data: bytes) -> Iterator[Value]:
        at = 0
        while at < count:
            known = self._registers.get(register + at)
            if known is None or at + known.count > count:
                rest = data[2 * at : 2 * at + 2]
                yield Value(f"0x{register + at:02X}", int.from_bytes(rest, "big") if len(rest) == 2 else None, "")
                at += 1
            else:
                yield _value(known, data[2 * at :])
                at += known.count

    def is_stop(self, spoken: Spoken) -> bool:
        if spoken.function not in (6, 16):
            return False
        words = {
            spoken.register + at // 2: int.from_bytes(spoken.data[at : at + 2], "big")
            for at in range(0, len(spoken.data) - 1, 2)
        }
        if words.get(self._control) in self._stop_words:
            return True
        return bool(words) and words.keys() <= self._speeds and not any(words.values())

    def is_telling(self, spoken: Spoken) -> bool:
        return spoken.register in self._telling and self.names(spoken, b"") is not None


_TLR_REGISTERS: Final = {
    register.address: register for register in (*tlr.MONITORING, *tlr.COMMANDS, *tlr.SETTINGS, *tlr.MANUFACTURER)
}
_TLR_STOPS = (TlrControl.STOP, TlrControl.EMERGENCY_STOP, TlrControl.STOP | TlrControl.EMERGENCY_STOP)

VOCABULARIES: Final[Mapping[str, Vocabulary]] = {
    "MKS": _MksCodes(),
    "ZLAC": _Memory(
        "ZLAC",
        zlac.BY_ADDRESS,
        range(zlac.FIRST, zlac.LAST + 1),
        zlac.CONTROL,
        frozenset({int(ZlacControl.EMERGENCY_STOP)}),
        frozenset({zlac.TARGET_VELOCITY.left.address, zlac.TARGET_VELOCITY.right.address}),
    ),
    "TL-R": _Memory(
        "TL-R",
        _TLR_REGISTERS,
        range(tlr.CONTROL.address, tlr.CONTROL.address + 1),
        tlr.CONTROL,
        frozenset(int(word) for word in _TLR_STOPS),
    ),
}
"""By the names of the families."""


def family_of(spoken: Iterable[Spoken]) -> str | None:
    """The family whose words all of these are, if it is one alone and some of them are telling; None otherwise.

    Only what a device has answered may be given: anybody may ask for anything.
    """
    heard = list(spoken)
    fitting = [
        family
        for family, words in VOCABULARIES.items()
        if heard and all(words.names(one, b"") is not None for one in heard) and any(map(words.is_telling, heard))
    ]
    return fitting[0] if len(fitting) == 1 else None
