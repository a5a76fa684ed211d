"""What an axis does beside moves and runs: a search for an origin, and motion that nobody waits for. Pure."""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.motion.courses import LOOK_AGAIN, LOOK_SOON, MUCH_LESS, Course, Verdict
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
        self.deadline = started_at + timeout

    def _is_troubled(self) -> bool:
        # It may push against a stop, and counts anew when it is there.
        return bool(self.state.value(Fact.FAULT))

    def _judge(self) -> Verdict:
        still = self.state.standstill
        if self._stands and self.state.since(still.since, self._watch) and self._done() is not None:
            return Verdict.DONE
        return self._in_time()

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
        proof: what must be asked where it stands before it has ended: it may have been stopped by what nobody meant.
        others as for `Course`.
    """

    def __init__(
        self,
        what: str,
        state: AxisState,
        started_at: float,
        grace: float,
        *,
        kept: bool = False,
        proof: tuple[Fact, ...] = (),
    ) -> None:
        super().__init__(what, state, started_at, grace)
        self.keeps = kept
        self.facts = proof
        self._grace = grace
        self._is_energised = bool(state.holds or state.value(Fact.ENABLED))
        """Its motor is known to have been energised."""
        self._place: tuple[int, float] | None = None
        """Where it was last seen to have come to, in counts, and when."""
        self._has_gone = False
        """It was seen elsewhere since it was told to go on."""
        self._was_seen_to_go = False
        self._rates = (NEVER, 0.0, 0.0)
        """When its position was last asked for, and how fast it went before, in counts a second: by the last two looks,
        and by the two before."""

    @property
    def goes_on(self) -> bool:
        return True

    def place(self) -> str:
        return "has stopped in a motion that nobody here waits for"

    def judge(self) -> Verdict:
        self._see()
        return super().judge()

    def failed(self) -> None:
        if self.state.value(Fact.ENABLED) is False:
            self.state.holds = False  # that was told: it is no news that it does not start

    def _is_troubled(self) -> bool:
        # Who moves it may have it count anew, or otherwise; that is told where it is noticed.
        return super()._is_troubled() if self.keeps else self._reports_trouble()

    def _is_let_go(self) -> bool:
        if self.keeps:
            return super()._is_let_go()
        # Somebody may set it in motion, as he thinks, whose motor is not energised yet; or have let go of it; or it was
        # not set in motion at all.
        return super()._is_let_go() and self._is_energised and self._was_seen_to_go and self.state.holds is not False

    def _judge(self) -> Verdict:
        state, still = self.state, self.state.standstill
        if self.keeps or not (self._stands or self._stays):
            return Verdict.GOES_ON
        if state.value(Fact.PUSHES) or (state.keeps and self._has_gone):
            return Verdict.DOUBTFUL  # it would go on when what holds it lets go, or nobody here has stopped it
        self._has_gone = False
        if still.unmoved >= _SAYS_NOTHING or (still.confirmed and state.since(still.since, self.facts)):
            return Verdict.DONE
        return Verdict.GOES_ON

    def due(self, fact: Fact) -> float:
        if self.keeps:
            return _FOREVER
        if self.state.stands is False:
            asked, rate, before = self._rates
            return asked + LOOK_AGAIN if fact is Fact.POSITION and rate < MUCH_LESS * before else _FOREVER
        still = self.state.standstill
        if fact in self.facts and still.confirmed and self.state.known(fact).at < still.since:
            return NEVER
        return self._due_at_end(fact, self._begun_at, LOOK_AGAIN)

    def _see(self) -> None:
        """Take in where it was seen, though what was told it since may have changed that."""
        state, seen = self.state, self.state.last(Fact.POSITION)
        if seen.value is not None and (
            self._place is None or abs(state.rule.moved(self._place[0], seen.value)) > state.rule.same
        ):
            self._has_gone = self._place is not None
            self._was_seen_to_go = self._was_seen_to_go or self._has_gone
            self._place = seen.value, seen.at
        begin, end, way = state.last_way
        if end > self._rates[0] and end - begin > LOOK_SOON:
            self._rates = end, abs(way) / (end - begin), self._rates[1]
        self._is_energised = self._is_energised or bool(state.value(Fact.ENABLED) or state.value(Fact.RUNNING))

    @property
    def _begun_at(self) -> float:
        return max(self.begun_at, self.state.motion.commanded_at + self._grace)

    @property
    def _stands(self) -> bool:
        return self.state.stands is True and self.state.standstill.until >= self._begun_at

    @property
    def _stays(self) -> bool:
        """Whether it stands though it is told speeds, each of which takes away what was known of where it stands."""
        if not self.state.keeps or self._place is None:
            return False
        return self.state.last(Fact.POSITION).at - self._place[1] >= 2 * self.state.rule.contradicted
