"""What the plant file and the commands must know of a family of drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rs485bus.sim import SimDevice


@dataclass(frozen=True, slots=True)
class Sign:
    """A harmless read whose answer tells that a drive may be of the family: registers, and what each may hold."""

    function: int
    """3 or 4."""
    register: int
    count: int = 1
    low: int = 0
    high: int = 0xFFFF
    is_address: bool = False
    """It holds the drive's own address."""

    def fits(self, values: Sequence[int], address: int) -> bool:
        """Whether an answer is what the family would say."""
        if len(values) != self.count:
            return False
        return values[0] == address if self.is_address else all(self.low <= value <= self.high for value in values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """What the commands must know of a family."""

    name: str
    """As it stands in plant files: "mks"."""
    title: str
    """As people call it."""
    facade: Callable[[], Callable[..., Any]]
    """Returns its facade's class, which is called with a bus, an address, and its own options by name. What may stand
    in a plant file are these options."""
    sides: tuple[str, ...] = ()
    """The facade's attributes that are axes, where one address has several; none where the facade is the axis."""
    by_side: frozenset[str] = frozenset()
    """Options that the facade takes as a tuple, one for each side."""
    addresses: tuple[int, int] = (1, 247)
    watchdog: tuple[float, float] | None = None
    """Between which times, in seconds, its watchdog can be set; None where it has none."""
    baudrate: int = 115200
    """bit/s as shipped."""
    baudrates: tuple[int, ...] = ()
    """What it can be set to, in bit/s."""
    signs: tuple[Sign, ...] = ()
    """What tells a drive of the family from others; all must fit. The first one is asked at every address of a scan, if
    no other is answered there. None where it cannot be told."""
    version: Sign | None = None
    """What holds its version."""
    questions: Callable[[], Sequence[Any]] | None = None
    """What its manual leaves open, as `rs485bus.bench.verify.question.Question`; None where that is not known."""
    simulate: Callable[[int, Mapping[str, Any]], SimDevice] | None = None
    """A virtual drive at an address, with the options of the plant file; None where there is none."""
