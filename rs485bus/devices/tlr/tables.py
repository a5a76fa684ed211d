"""What is edited by index; among it the paths, to which inputs can send the axis.

Paths are chosen by inputs alone (TL-R manual, 3.2.2, 3.3): four of them are selection switches, a fifth is the trigger.
The switches count 1, 2, 4 and 8 where they are on; what they add up to is the path:

    ========  ====  ====  ====  ====  ===================  ===================
    path      SELECT_0..3             registers of a path  of a speed path
    ========  ====  ====  ====  ====  ===================  ===================
    0         off   off   off   off   80..84               176..178
    1         on    off   off   off   86..90               179..181
    2         off   on    off   off   92..96               182..184
    3         on    on    off   off   98..102              185..187
    4         off   off   on    off   104..108             188..190
    5         on    off   on    off   110..114             191..193
    6         off   on    on    off   116..120             194..196
    7         on    on    on    off   122..126             197..199
    8         off   off   off   on    128..132             200..202
    9         on    off   off   on    134..138             203..205
    10        off   on    off   on    140..144             206..208
    11        on    on    off   on    146..150             209..211
    12        off   off   on    on    152..156             212..214
    13        on    off   on    on    158..162             215..217
    14        off   on    on    on    164..168             218..220
    15        on    on    on    on    170..174             221..223
    ========  ====  ====  ====  ====  ===================  ===================

A path is gone to when its trigger closes. A speed path turns the motor while its trigger is closed.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from rs485bus.bus.handle import Handle
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.parameters import TlrParameters
from rs485bus.devices.tlr.values import PathMode, PathTrigger
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Path:
    """Where an input can send the axis (3.5.4)."""

    target: float
    """In units of the axis; a distance where paths are relative (`Paths.mode`)."""
    rpm: int = 300
    """0..3000."""
    acceleration_ms: int = 100
    """0..2000."""
    deceleration_ms: int = 100
    """0..2000."""


@dataclass(frozen=True, slots=True)
class SpeedPath:
    """How fast an input can turn the motor (3.5.5)."""

    rpm: int
    """-3000..3000."""
    acceleration_ms: int = 100
    """0..2000."""
    deceleration_ms: int = 100
    """0..2000."""


class Table(Generic[T]):
    """Entries that are set (`table[3] = entry`) and asked for (`await table[3]`) by index.

    What was set before is written when the answer comes.

    Args:
        parameters: those of the drive.
        entries: where they are kept.
        values: what is written for an entry.
        typed: the entry that was read.
    """

    def __init__(
        self,
        parameters: TlrParameters,
        entries: Sequence[Block | Register[Any]],
        values: Callable[[T], tuple[Any, ...]],
        typed: Callable[..., T],
    ) -> None:
        self._parameters = parameters
        self._entries = entries
        self._values = values
        self._typed = typed

    def __len__(self) -> int:
        return len(self._entries)

    def __setitem__(self, index: int, entry: T) -> None:
        self.set(index, entry)

    def __getitem__(self, index: int) -> Coroutine[Any, Any, T]:
        """Ask the drive for an entry."""
        return self._ask(self._entry(index))

    def set(self, index: int, entry: T) -> Handle[None]:
        """Write an entry once what is queued before is done, and read it back.

        Raises:
            IndexError: there is none of that number.
            LimitExceeded: a value is out of its range; nothing is queued.
        """
        where = self._entry(index)
        where.encode(*self._values(entry))
        # How many pulses a distance is may be known only then.
        return self._parameters.order(
            f"{where.name} = {entry}", lambda: self._parameters.drive.writer.put(where, *self._values(entry))
        )

    async def _ask(self, where: Block | Register[Any]) -> T:
        await self._parameters.set_up()
        values = await self._parameters.ask(where)
        return self._typed(values) if isinstance(where, Register) else self._typed(*values)

    def _entry(self, index: int) -> Block | Register[Any]:
        if not 0 <= index < len(self._entries):
            raise IndexError(f"{self._parameters.drive.name}: {index} is outside 0..{len(self._entries) - 1}")
        return self._entries[index]


class Paths(Table[Path]):
    """The 16 paths.

    Args:
        parameters: those of the drive.
        to_counts: from units of the axis to pulses.
        to_units: and back.
    """

    def __init__(
        self, parameters: TlrParameters, to_counts: Callable[[float], int], to_units: Callable[[int], float]
    ) -> None:
        def values(path: Path) -> tuple[int, ...]:
            return to_counts(path.target), path.rpm, path.acceleration_ms, path.deceleration_ms

        def typed(target: int, *others: int) -> Path:
            return Path(to_units(target), *others)

        super().__init__(parameters, r.POSITION_PATHS, values, typed)

    def set_mode(self, mode: PathMode) -> Handle[None]:
        """Whether their targets are distances, as shipped, or positions (3.2.2)."""
        return self._parameters.put(r.PATH_MODE, mode)

    def set_trigger(self, trigger: PathTrigger) -> Handle[None]:
        """Whether a trigger interrupts a positioning under way, as shipped, or is ignored (3.2.2)."""
        return self._parameters.put(r.PATH_TRIGGER, trigger)


class SpeedPaths(Table[SpeedPath]):
    """The 16 speed paths.

    Args:
        parameters: those of the drive.
        sign: 1, or -1 where the axis counts the other way round.
    """

    def __init__(self, parameters: TlrParameters, sign: int) -> None:
        def values(path: SpeedPath) -> tuple[int, ...]:
            return sign * path.rpm, path.acceleration_ms, path.deceleration_ms

        def typed(rpm: int, *others: int) -> SpeedPath:
            return SpeedPath(sign * rpm, *others)

        super().__init__(parameters, r.SPEED_PATHS, values, typed)
