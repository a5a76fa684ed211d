"""The steps by which a drive is told something. Pure.

A plan is a generator: it yields a step, gets what came of it, and yields the next one. So it may branch, is tested by
plain calls, and every step can be made to fail: what a step raises is raised at its `yield`. It neither waits nor
repeats; whoever carries it out does (`executor`). What it returns is its result.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeVar

from rs485bus.motion.state import Fact
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Repeat

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Ask:
    """Send a request that sets nothing in motion, but for one by which the drive turns by itself (`turns`). Gives the
    frame that answers it."""

    request: Request
    repeat: Repeat = Repeat.SAFE
    reply_timeout: float | None = None
    """Seconds that the drive may take to answer; None for as long as usual."""
    insist: bool = False
    """Send it though the drive counts as offline."""
    turns: bool = False
    """The drive turns the motor by itself, and says so until it answers again (`AnswersAgain`): it is not looked at
    until then, and is stopped where that is not waited for."""


@dataclass(frozen=True, slots=True)
class AnswersAgain:
    """Wait until a drive that restarts answers again, twice in a row: it may do so once more before it restarts.

    Gives whether it did so in time.
    """

    request: Request
    ready: Callable[[bytes], bool]
    """Whether a reply shows that it is ready."""
    timeout: float
    pause: float = 1.0
    """Seconds for which it is left alone first, and between two attempts."""


@dataclass(frozen=True, slots=True)
class Know:
    """Have these facts in the state of the axis, asked for after whatever could have changed them."""

    facts: tuple[Fact, ...]
    afresh: bool = False
    """Ask for them now, however new they are."""


@dataclass(frozen=True, slots=True)
class Stand:
    """Have the axis stand: stop it if it moves."""

    surely: bool = False
    """Stop it also if it stands: it must not start any more."""
    whole: bool = False
    """All axes of the drive."""


@dataclass(frozen=True, slots=True)
class OthersStand:
    """Wait until the drive's axes stand that take no part in this. Other plans may be carried out meanwhile."""


@dataclass(frozen=True, slots=True)
class KeepFed:
    """Have the drive's watchdog fed from now on, as a whole: it was found to be on. Gives whether it was fed already.

    Raises `WatchdogInfeasible` where it cannot be fed in time.
    """

    timeout: float
    """Seconds to which it is set."""


@dataclass(frozen=True, slots=True)
class MustStand:
    """Raise `NotStanding` if it moves."""

    what: str
    """What it must stand for."""


@dataclass(frozen=True, slots=True)
class Pause:
    """Leave the drive alone for a while."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Start:
    """The frame that sets the axis in motion, with the one that would end that.

    Where its reply is lost it is settled by reading whether it was taken, and said again if it was not: the whole plan
    is carried out once more.
    """

    request: Request
    stop: Request | None
    """What stops the axis from then on, by its ramp where there is such a stop. Where the family's own code fails in
    `stops`, the axis is stopped by this. None where only `stops` says that."""
    stopping: float
    """Seconds that this takes."""
    repeat: Repeat = Repeat.VERIFY
    once: bool = False
    """Said twice it would move the axis twice."""
    shows_after: float = 0.0
    """Seconds, beside the drive's own, after which it can be seen to move."""
    signs: tuple[Fact, ...] = ()
    """What else shows whether it was taken."""
    taken: Callable[[], bool] | None = None
    """Whether these show it."""


@dataclass(frozen=True, slots=True)
class Ended:
    """Wait until the motion that was started has ended: until the axis stands and `done` says so.

    Raises what ended it otherwise.
    """

    done: Callable[[], bool | None]
    """Whether it is done, asked when the axis stands. None: ask again. False: it has ended without being done."""
    watch: tuple[Fact, ...]
    """What that depends on."""
    timeout: float
    """Seconds from the start."""


Step = Ask | AnswersAgain | Know | Stand | OthersStand | KeepFed | MustStand | Pause | Start | Ended
Plan = Generator[Step, Any, T]


def nothing() -> Plan[None]:
    """A plan without a step."""
    yield from ()
