"""A run, and whether the axis does that. Pure."""

from __future__ import annotations

import math

from rs485bus.motion.courses import LOOK_AGAIN, LOOK_SOON, Course, Verdict
from rs485bus.motion.profile import RunProfile, is_speed
from rs485bus.motion.run_limits import RunLimits
from rs485bus.motion.state import AxisState, Fact

_FOREVER = float("inf")


class RunCourse(Course):
    """A speed, perhaps for a time.

    Args:
        start: where it began, in counts; None if that is not known.
        profile: how it goes.
        counts_per_turn: of the axis.
        limits: between which positions it may go; None for everywhere.
        may_restart: its drive does not tell its restarts. A position that jumps back shows one.
        others as for `Course`.
    """

    def __init__(
        self,
        what: str,
        state: AxisState,
        started_at: float,
        grace: float,
        *,
        profile: RunProfile,
        counts_per_turn: int,
        limits: RunLimits | None = None,
        may_restart: bool = False,
    ) -> None:
        super().__init__(what, state, started_at, grace)
        # Where it turns round, it goes back.
        self._way = math.copysign(1, profile.rpm) if may_restart and profile.rpm * profile.before >= 0 else 0
        self._last: int | None = None
        self._limits = limits
        self.profile = profile
        self.keeps = profile.rpm != 0 and profile.duration is None
        self._counts_per_turn = counts_per_turn
        self.reached = not self.keeps
        self.eta = started_at + (profile.ramp if self.keeps else profile.ends_after)
        self.deadline = started_at + 2 * profile.ramp + 1 + (profile.duration or 0.0)

    @property
    def goes_on(self) -> bool:
        return self.keeps

    @property
    def stop_at(self) -> float:
        if self._limits is None or (self.keeps and self.state.stopped_at > self.started_at):
            return _FOREVER
        counts = self._counts_per_turn / 60
        measured = (self.state.value(Fact.SPEED) or 0.0) * counts
        return self._limits.stop_at(self.state, self.profile.rpm * counts, measured)

    def place(self) -> str:
        return f"has stopped during its {self.what}"

    def _judge(self) -> Verdict:
        if self.profile.rpm == 0:
            return Verdict.DONE if self._stands else self._in_time()
        if self.keeps and self.state.stopped_at > self.started_at:
            return Verdict.DONE if self._stands else Verdict.GOES_ON  # somebody has stopped it by a frame of this bus
        if self._is_backwards():
            self.state.suspect("its position jumped back: the drive may have restarted.")
            return Verdict.DOUBTFUL
        if self._is_held_up(self.profile.turns_after, self._counts_per_turn):
            return Verdict.DOUBTFUL
        if not self.keeps:
            over = self.state.standstill.until >= self.eta
            return Verdict.DONE if self._stands and over else self._in_time()
        if not self.reached and self._has_speed():
            self.reached = True
            return Verdict.REACHED
        return Verdict.GOES_ON if self.reached else self._in_time()

    def _is_backwards(self) -> bool:
        """Whether it was further on when it was last asked, by more than a load moves it, and is where a drive counts
        from after a restart."""
        position = self.state.value(Fact.POSITION)
        last, self._last = self._last, position if position is not None else self._last
        if not self._way or last is None or position is None:
            return False
        return self._way * self.state.rule.moved(last, position) < -self.state.jump and self.state.may_count_anew

    def due(self, fact: Fact) -> float:
        if self.keeps and self.state.stopped_at > self.started_at:
            return self._due_at_end(fact, self.state.stopped_at, LOOK_AGAIN)
        behind = self._due_where_behind(fact, self.profile, self._counts_per_turn)
        if behind < _FOREVER:
            return behind
        if fact is Fact.POSITION and self.stop_at < _FOREVER:
            asked = self.state.last(Fact.POSITION).at
            soon = asked + max(LOOK_SOON, (self.stop_at - asked) / 2)
            return soon if self.keeps else min(soon, self._due_at_end(fact, max(self.eta, self.begun_at), LOOK_SOON))
        if not self.keeps:
            return self._due_at_end(fact, max(self.eta, self.begun_at), LOOK_AGAIN / 2)
        if fact is Fact.SPEED and not self.reached:
            asked = self.state.known(Fact.SPEED).at
            return self.eta if asked < self.eta else asked + LOOK_AGAIN
        return _FOREVER

    def _has_speed(self) -> bool:
        speed = self.state.known(Fact.SPEED)
        return speed.value is not None and speed.at >= self.started_at and is_speed(speed.value, self.profile.rpm)
