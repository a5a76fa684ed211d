"""What an axis was told to do, and whether it does that. Pure.

A course is judged by the state of the axis after every reply, and says when it wants to know what next. It does not
find out why something is wrong; that is asked then (`diagnosis`).
"""

from __future__ import annotations

import enum
import math
from abc import ABC, abstractmethod
from collections.abc import Callable

from rs485bus.motion.profile import Profile, RunProfile
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import AxisState, Fact

_SEEN_TO_STAND = 1.0
"""Seconds for which one that is where it should be is looked at, to see it stand."""
SETTLING = 0.3
"""Seconds in which an axis that has arrived may come nearer to its target."""
_FOREVER = float("inf")
_SHOWS = 10
"""An axis that should have gone this many times as far as a standing one may seem to go, and did not, is held up."""
_FAR_APART, MUCH_LESS = 0.1, 0.7
LOOK_AGAIN, LOOK_SOON = 0.05, 0.01


class Verdict(enum.Enum):
    """What becomes of a course."""

    GOES_ON = enum.auto()
    REACHED = enum.auto()
    """Its speed is reached; it goes on."""
    DONE = enum.auto()
    DOUBTFUL = enum.auto()
    """Something is wrong. It is to be found out what."""
    OVERDUE = enum.auto()
    """It takes too long."""
    SILENT = enum.auto()
    """The drive does not answer any more."""


class Course(ABC):
    """What an axis was told to do.

    Args:
        what: names it in messages.
        state: what is known of the axis.
        started_at: when its first frame was sent.
        grace: seconds within which the axis may stand though it was told to start.
    """

    interval = _FOREVER
    """Seconds between two looks, where others depend on the axis."""
    keeps = False
    """It goes on until something ends it: nobody waits for its end."""
    deadline = _FOREVER
    """When it must have ended."""
    reached = True
    """Nobody waits for its speed, or not any more."""
    facts: tuple[Fact, ...] = ()
    """What it may want to know beside what every axis is asked that moves."""

    def __init__(self, what: str, state: AxisState, started_at: float, grace: float) -> None:
        self.what = what
        self.state = state
        self.started_at = started_at
        self.begun_at = started_at + grace
        self._lost = state.lost
        self._stalled = state.last(Fact.STALLED).value is True
        """It reported a stall before: that it still does is no news."""
        self._limit = state.last(Fact.LIMIT).value
        """The limit at which it began: that it is still there is no news."""

    @property
    def goes_on(self) -> bool:
        """Whether nobody waits for its end: it is over when the axis was stopped, and seen standing."""
        return False

    def judge(self) -> Verdict:
        """What becomes of it, by what is known now."""
        if self._is_troubled():
            return Verdict.DOUBTFUL
        return self._judge()

    @abstractmethod
    def _judge(self) -> Verdict:
        """The same, where neither the drive nor its position says that something is wrong."""

    def due(self, fact: Fact) -> float:
        """When a fact is to be asked for, beside what is asked of every axis that moves."""
        return _FOREVER

    @property
    def between(self) -> tuple[int, int | None]:
        """From where to where the axis goes, in counts; None where that has no known end."""
        return self.state.last(Fact.POSITION).value or 0, None

    @property
    def stop_at(self) -> float:
        """When it must be told to stop, lest it leaves the limits of the axis."""
        return _FOREVER

    def failed(self) -> None:
        """It has ended without being done: nothing more is told for it."""
        return

    def place(self) -> str:
        """Where the axis stands, for messages."""
        return "has stopped"

    def _is_troubled(self) -> bool:
        """Whether something is wrong, by its position, or by what the drive says."""
        return self.has_lost_reference or self._reports_trouble()

    def _reports_trouble(self) -> bool:
        state = self.state
        return bool(
            state.value(Fact.FAULT)
            or (state.value(Fact.STALLED) and not self._stalled and state.stands is not False)
            or self._is_let_go()
            or self._is_at_a_limit()
        )

    @property
    def has_lost_reference(self) -> bool:
        """Whether its positions are not to be trusted any more since it began."""
        return self.state.lost != self._lost

    def _is_let_go(self) -> bool:
        """Whether its motor does not hold it any more."""
        return self.state.value(Fact.ENABLED) is False

    def _is_at_a_limit(self) -> bool:
        """Whether it has come to a limit since it began."""
        limit = self.state.value(Fact.LIMIT)
        if not limit:
            self._limit = limit
        return bool(limit) and limit != self._limit

    @property
    def _stands(self) -> bool:
        """Whether it stands, though it had the time to start."""
        return self.state.stands is True and self.state.standstill.until >= self.begun_at

    def _in_time(self, longer: float = 0.0) -> Verdict:
        return Verdict.OVERDUE if self._is_overdue(self.deadline + longer) else Verdict.GOES_ON

    def _is_overdue(self, deadline: float) -> bool:
        """Whether it was asked after a time and had not ended. That an answer takes long says nothing."""
        return max(self.state.known(Fact.POSITION).at, self.state.known(Fact.RUNNING).at) > deadline

    @property
    def _begins(self) -> tuple[float, float]:
        """When it began, at the soonest and at the latest."""
        return self.started_at, self.begun_at

    def _is_held_up(self, turns_after: Callable[[float], float], counts_per_turn: int) -> bool:
        """Whether it does not move though it should have."""
        still = self.state.standstill
        ways = [abs(turns_after(still.until - late) - turns_after(still.since - late)) for late in self._begins]
        return still.unmoved > 0 and min(ways) * counts_per_turn > _SHOWS * self.state.rule.same

    def _due_where_behind(self, fact: Fact, profile: Profile | RunProfile | None, counts_per_turn: int) -> float:
        """When to ask for a fact where it went much less than it should have between two looks that are far apart:
        whether it was let go, then whether it goes on."""
        begin, end, way = self.state.last_way
        if fact not in (Fact.POSITION, Fact.ENABLED) or not profile:
            return _FOREVER
        if begin < self.begun_at or end - begin < _FAR_APART:
            return _FOREVER
        ways = [abs(profile.turns_after(end - late) - profile.turns_after(begin - late)) for late in self._begins]
        if abs(way) >= MUCH_LESS * min(ways) * counts_per_turn - _SHOWS * self.state.rule.same:
            return _FOREVER
        if fact is Fact.POSITION:
            return end + LOOK_AGAIN / 2
        return NEVER if self.state.known(fact).at < end else _FOREVER

    def _due_at_end(self, fact: Fact, end: float, pause: float) -> float:
        """When to ask for a fact, to see the axis stand soon after a time."""
        still, rule = self.state.standstill, self.state.rule
        asked = self.state.known(Fact.POSITION).at
        if fact is Fact.POSITION:
            if asked < end:
                return end
            settles = still.unmoved > 0 or still.confirmed
            return max(asked + LOOK_SOON / 2, still.since + rule.apart) if settles else asked + pause
        if fact is Fact.RUNNING and asked >= end and not still.confirmed:
            again = pause if still.verdict is False else LOOK_SOON
            return max(still.since, self.state.known(Fact.RUNNING).at + again / 2)
        return _FOREVER


class MoveCourse(Course):
    """A move to a target.

    Args:
        start: where it began, in counts.
        target: where it goes.
        tolerance: counts by which the axis may differ from it in the end.
        profile: how it goes.
        counts_per_turn: of the axis.
        proof: what must be asked where it stands before it counts as arrived at zero, because a restart could look like
            that.
        late: seconds after its start was sent within which the drive had answered that.
        others as for `Course`.
    """

    def __init__(
        self,
        what: str,
        state: AxisState,
        started_at: float,
        grace: float,
        *,
        start: int,
        target: int,
        tolerance: int,
        profile: Profile,
        counts_per_turn: int,
        proof: tuple[Fact, ...] = (),
        late: float = 0.0,
    ) -> None:
        super().__init__(what, state, started_at, grace)
        self.start = start
        self.target = target
        self.tolerance = tolerance
        self.profile: Profile | None = profile
        self._marks = proof
        self._furthest = 0.0
        """How far it has gone, in counts."""
        self._counts_per_turn = counts_per_turn
        self.begun_at += state.rule.shows_after(profile.up / 60 * counts_per_turn)
        self.change(target, started_at + late + profile.duration, profile)

    def change(self, target: int, eta: float, profile: Profile | None) -> None:
        """It goes elsewhere now, and should be there at a time; by no known profile, perhaps."""
        self.target = target
        self.facts = self._marks if abs(target) <= self.state.jump else ()
        self.eta = eta
        self.profile = profile
        self.deadline = 2 * eta - self.started_at + 1
        self._pause = min(max((eta - self.started_at) / 50, LOOK_SOON), LOOK_AGAIN)

    @property
    def between(self) -> tuple[int, int | None]:
        return super().between[0], self.target

    def place(self) -> str:
        deviation = abs(self._way(self.state.last(Fact.POSITION).value, self.target))
        stands = "stands" if self.state.stands else "is"
        return f"{stands} {deviation} {self.state.unit} short of where it was sent"

    @property
    def deviation(self) -> int | None:
        """How far it is from its target, in counts, by what was asked since it was started."""
        known = self.state.known(Fact.POSITION)
        return None if known.value is None or known.at < self.started_at else abs(self._way(known.value, self.target))

    def _judge(self) -> Verdict:
        deviation = self.deviation
        if deviation is None:
            return self._in_time()
        arrived = deviation <= self.tolerance and self._has_moved()
        if arrived:
            stands = self.state.stands and self.state.since(self._arrived_at, self.facts)
            return Verdict.DONE if stands else self._in_time(_SEEN_TO_STAND)
        if self._is_backwards():
            self.state.suspect("its position jumped back: the drive may have restarted.")
            return Verdict.DOUBTFUL
        if self._stands:
            near = deviation <= self.state.jump
            settles = near and self.state.standstill.unmoved < SETTLING
            return self._in_time() if settles else Verdict.DOUBTFUL
        if self.profile is not None and self._is_held_up(self.profile.turns_after, self._counts_per_turn):
            return Verdict.DOUBTFUL
        return self._in_time()

    def due(self, fact: Fact) -> float:
        behind = self._due_where_behind(fact, self.profile, self._counts_per_turn)
        if behind < _FOREVER:
            return behind
        if fact is not Fact.POSITION and fact is not Fact.RUNNING and fact not in self.facts:
            return _FOREVER
        deviation = self.deviation
        if fact is Fact.POSITION and deviation is None:
            return min(self.begun_at, self.eta)
        near = deviation is not None and deviation <= max(self.tolerance, self.state.jump)
        if fact is Fact.POSITION and near and not self._has_moved():
            return self.begun_at  # it may have to start yet
        if fact in self.facts and near and self.state.stands and self.state.known(fact).at < self._arrived_at:
            return NEVER
        asked = self.state.known(Fact.POSITION).at
        return self._due_at_end(fact, min(self.eta, asked) if near else self.eta, self._pause)

    @property
    def _arrived_at(self) -> float:
        """When it was first seen where it stands."""
        return max(self.started_at, self.state.standstill.since)

    def _is_at_a_limit(self) -> bool:
        # It may have been sent just there.
        arrives = self.deviation is not None and self.deviation <= self.tolerance
        return super()._is_at_a_limit() and not arrives

    def _has_moved(self) -> bool:
        """Whether it can be seen that it has gone some of its way, or had the time for a way that cannot be seen."""
        way = self._way(self.start, self.target)
        gone = self._way(self.start, self.state.value(Fact.POSITION))
        if gone * way > 0 and abs(gone) > self.state.rule.same:
            return True
        shown = abs(way) > 2 * self.state.rule.same
        return not shown and self.state.standstill.until >= self.begun_at

    def _is_backwards(self) -> bool:
        """Whether it is further from its target than it was, or than where it began."""
        if self.profile is None:
            return False
        way = self._way(self.start, self.target)
        gone = math.copysign(1, way) * self._way(self.start, self.state.value(Fact.POSITION))
        self._furthest = max(self._furthest, gone)
        return gone < self._furthest - self.state.jump

    def _way(self, start: int, end: int) -> int:
        return self.state.rule.moved(start, end)
