"""One axis of a drive, as its supervisor sees it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rs485bus.errors import MotionError
from rs485bus.motion.courses import Course, Verdict
from rs485bus.motion.events import Changes, EventKind
from rs485bus.motion.state import AxisState, Fact

_FOREVER = float("inf")

Told = Callable[[Verdict, MotionError | None], None]
"""Called when a course has reached its speed, has ended, or failed of an error."""


@dataclass(slots=True)
class Watched:
    """One axis that is looked at whenever it may move."""

    state: AxisState
    name: str
    on_trouble: Callable[[MotionError], None]
    tell: Callable[[EventKind, str], None]
    changes: Changes
    course: Course | None = None
    told: Told | None = None
    doubted_at: float | None = None
    doubted_until: float = _FOREVER
    """Since when it is being found out what is wrong; and until when, whatever the drive has not told by then."""
    lost: str = ""
    """Why its positions were not to be trusted when that was last looked at."""
    silent: bool = False
    """It was told that its drive does not answer."""
    starting: bool = False
    """Somebody is about to start or to stop it, and looks at it meanwhile."""
    unjudged: bool = False
    """What its drive tells could not be judged when that was last tried."""

    def told_where_at(self, telling: Iterable[Fact]) -> float:
        """When it was last told where it is; infinity where that is not waited for: it does nothing, or it is being
        found out what is wrong with it."""
        if self.course is None or self.doubted_at is not None:
            return _FOREVER
        return max(self.state.last(fact).at for fact in telling)
