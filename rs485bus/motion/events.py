"""What happens to an axis, told to whoever listens."""

from __future__ import annotations

import asyncio
import enum
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import dataclass
from typing import Any

from rs485bus.errors import DriveFault, LimitReached, MotionError, MotorStalled, ReferenceLost
from rs485bus.motion.state import AxisState, Fact

_KEPT = 256
"""Events that wait for a listener; of more the oldest are dropped."""


class EventKind(enum.Enum):
    """What happened."""

    FAULT = "fault"
    LIMIT = "limit"
    STALL = "stall"
    RESTART = "restart"
    TRIP = "trip"
    """The bus stopped it for safety: its watchdog may have tripped, or a lease has lapsed."""
    STOP = "stop"
    """It was stopped, and seen standing."""
    LOST = "lost"
    """Its drive does not answer, or the port is gone."""
    BACK = "back"
    """Its drive answers again."""
    STALE = "stale"
    """The set-points of its stream ceased to come: it was stopped by its ramp."""
    FAILED = "failed"
    """It did not do what it was told, for another reason."""


_KINDS: tuple[tuple[type[MotionError], EventKind], ...] = (
    (DriveFault, EventKind.FAULT),
    (MotorStalled, EventKind.STALL),
    (LimitReached, EventKind.LIMIT),
    (ReferenceLost, EventKind.RESTART),
)


def kind_of(error: MotionError) -> EventKind:
    """What an error of an axis is an event of."""
    return next((kind for family, kind in _KINDS if isinstance(error, family)), EventKind.FAILED)


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened to an axis."""

    kind: EventKind
    axis: str
    """Its name."""
    at: float
    """When, on the event loop's clock."""
    what: str
    """What happened, in words."""


class Events:
    """Hands the events of one axis on.

    Args:
        name: the axis.
        now: the time.
        spawn: makes a task that ends with the bus.
    """

    def __init__(
        self,
        name: str,
        now: Callable[[], float],
        spawn: Callable[[Coroutine[Any, Any, None], str], asyncio.Task[None]],
    ) -> None:
        self._name = name
        self._now = now
        self._spawn = spawn
        self._listeners: list[tuple[deque[Event], asyncio.Event]] = []

    def tell(self, kind: EventKind, what: str) -> None:
        """It happened."""
        event = Event(kind, self._name, self._now(), what)
        for waiting, wake in self._listeners:
            waiting.append(event)
            wake.set()

    async def listen(self) -> AsyncIterator[Event]:
        """What happens from now on, until the bus is closed."""
        listener = (deque[Event](maxlen=_KEPT), asyncio.Event())
        self._listeners.append(listener)
        waiting, wake = listener
        open_bus = self._spawn(_for_ever(), f"listening to {self._name}")
        open_bus.add_done_callback(lambda _: wake.set())
        try:
            while waiting or not open_bus.done():
                await wake.wait()
                wake.clear()
                while waiting:
                    yield waiting.popleft()
        finally:
            open_bus.cancel()
            self._listeners.remove(listener)


async def _for_ever() -> None:
    await asyncio.get_running_loop().create_future()


class Changes:
    """Tells what begins to be wrong with an axis, by what is known of it, whoever asked for that.

    Args:
        state: what is known of it.
        tell: called with what begins.
    """

    _FACTS = ((Fact.FAULT, EventKind.FAULT), (Fact.STALLED, EventKind.STALL), (Fact.LIMIT, EventKind.LIMIT))

    def __init__(self, state: AxisState, tell: Callable[[EventKind, str], None]) -> None:
        self._state = state
        self._tell = tell
        self._told: dict[EventKind, object] = {}
        self._seen = 0

    def look(self) -> None:
        """Something may be known that was not."""
        if self._seen == self._state.news:
            return
        self._seen = self._state.news
        for fact, kind in self._FACTS:
            value = self._state.last(fact).value
            if fact is Fact.STALLED and value and self._state.stands is False:
                self._seen = -1  # its positions show that it moves: that is looked at again
                continue
            if value is not None and self._told.get(kind) != value:
                self._told[kind] = value
                if value:
                    self._tell(kind, value if isinstance(value, str) else "the drive reports a stall")

    def failed(self, error: MotionError, *, silent: bool) -> None:
        """What it was told, or did, has failed."""
        kind = EventKind.LOST if silent else kind_of(error)
        if not self._told.get(kind):  # else that was told when it began
            self._tell(kind, str(error))
