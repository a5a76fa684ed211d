"""What an axis does beside moves and runs: a search for an origin, and motion that nobody waits for. Pure."""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.motion.courses import LOOK_AGAIN, LOOK_SOON, Course, Verdict
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import AxisState, Fact

_HOMING_LOOK = 0.1
_SAYS_NOTHING = 1.0
"""Seconds for which the position must stay where the status goes on saying that it moves, and nobody knows why."""
_FOREVER = float("inf")


class HomingCourse(Course):
    """A search for an origin, which the drive makes by itself.

    Args:
        done: whether it has found what it looked for, asked when the axis stands; None if that cannot be told yet.
        watch: what that depends on.
        timeout: seconds that it may take.
        others as for `Course`.
    """

    def __init__(
        self,
        what: str,
        state: AxisState,
        started_at: float,
        grace: float,
        *,
        done: Callable[[], bool | None],
        watch: tuple[Fact, ...],
        timeout: float,
    ) -> None:
        super().__init__(what, state, started_at, grace)
        self._done = done
        self._watch = self.facts = watch
        self._deadline = started_at + timeout

    def _is_troubled(self) -> bool:
        # It may push against a stop, and counts anew when it is there.
        return bool(self.state.value(Fact.FAULT))

    def _judge(self) -> Verdict:
        still = self.state.standstill
        if self._stands and self.state.since(still.since, self._watch) and self._done() is not None:
            return Verdict.DONE
        return Verdict.OVERDUE if self._is_overdue(self._deadline) else Verdict.GOES_ON

    def due(self, fact: Fact) -> float:
        still, known = self.state.standstill, self.state.known(fact)
        says_so = self.state.value(Fact.RUNNING) is False
        if fact is Fact.RUNNING:
            pause = LOOK_SOON if says_so and not still.confirmed else _HOMING_LOOK
            return max(self.begun_at, known.at + pause)
        if not says_so and not self.state.stands:
            return _FOREVER
        if fact is Fact.POSITION:
            pause = LOOK_AGAIN if self.state.stands else self.state.rule.apart
            return max(self.begun_at, known.at + pause)
        if fact in self._watch and self.state.stands:
            return max(still.since, known.at + LOOK_AGAIN) if known.at >= still.since else NEVER
        return _FOREVER


class ForeignCourse(Course):
    """A motion that nobody waits for: one that somebody else began, or a torque that is kept.

    Args:
        kept: it may move again though it stands.
        others as for `Course`.
    """

    def __init__(self, what: str, state: AxisState, started_at: float, grace: float, *, kept: bool = False) -> None:
        super().__init__(what, state, started_at, grace)
        self.keeps = kept

    @property
    def goes_on(self) -> bool:
        return True

    def _is_troubled(self) -> bool:
        if self.keeps:
            return super()._is_troubled()
        return bool(self.state.value(Fact.FAULT)) or self._is_at_a_limit()

    def _judge(self) -> Verdict:
        still = self.state.standstill
        if self.keeps or not self._stands:
            return Verdict.GOES_ON
        if not still.confirmed and self.state.value(Fact.STALLED):
            return Verdict.DOUBTFUL  # it pushes, and would go on when what holds it lets go
        return Verdict.DONE if still.confirmed or still.unmoved >= _SAYS_NOTHING else Verdict.GOES_ON

    def due(self, fact: Fact) -> float:
        if self.keeps or self.state.stands is False:
            return _FOREVER
        return self._due_at_end(fact, self.begun_at, LOOK_AGAIN)
