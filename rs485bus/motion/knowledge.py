"""Asks a drive for what is not known of an axis, or too old to decide by."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import settle
from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.errors import BusError, DeviceRefused, NoReply, ReferenceLost, RequestFailed
from rs485bus.motion.diagnosis import LOST
from rs485bus.motion.drive import Drive, Reading, said_by_family
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import FRESH, AxisState, Fact
from rs485bus.wire.exceptions import Meaning, exception
from rs485bus.wire.frames import Request

_log = logging.getLogger("rs485bus")

_LOOK_AGAIN = 0.005
_ROUND = 1.5
"""How many times as long as the last look at a position the next one may take."""
_LOOKS, _DOUBT_LASTS = 2, 5.0
"""Looks that tell nothing, and seconds, after which it is given up to see whether an axis stands."""
_ATTEMPTS = 3
"""How often something is asked that is refused, whose answer tells nothing or may have been that to something older."""
_REFUSED = 0.02
"""Seconds after which something is asked again that was refused."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a drive has answered."""

    at: float
    """When it was asked, on the event loop's clock."""
    request: Request
    reply: bytes


class Questions:
    """Asks one drive. Who asks for the same while somebody else does gets the same answer.

    Args:
        bus: the bus it is on.
        drive: the drive.
    """

    def __init__(self, bus: Bus, drive: Drive) -> None:
        self._bus = bus
        self._drive = drive
        self._asking: dict[bytes, tuple[float, asyncio.Future[Answer | None]]] = {}
        """What is being asked, by its frame: since when, and who waits for that."""

    async def ask(self, fact: Fact, since: float | None = None, urgency: Urgency = Urgency.POLL) -> Answer:
        """Ask for a fact; or wait for the answer, where it is being asked for since a time. None: since now."""
        since = self._bus.now() if since is None else since
        while True:
            request = self._free(fact)
            asked_at, answered = self._asking.get(request.adu, (NEVER, None))
            if answered is None or asked_at < since:
                return await self._ask(request, urgency)
            answer = await asyncio.shield(answered)
            if answer is not None:
                return answer

    async def _ask(self, request: Request, urgency: Urgency) -> Answer:
        now, answered = self._bus.now(), asyncio.get_running_loop().create_future()
        self._asking[request.adu] = (now, answered)
        answer = None
        try:
            answer = Answer(now, request, await self._until_not_refused(request, urgency))
            return answer
        finally:
            if self._asking.get(request.adu, (NEVER, None))[1] is answered:
                del self._asking[request.adu]
            settle(answered, answer)  # None: who waits for it asks anew

    async def _until_not_refused(self, request: Request, urgency: Urgency) -> bytes:
        """Ask; and ask again where it is said that the drive has failed to answer this time, or is still at it."""
        for _ in range(_ATTEMPTS - 1):
            try:
                return await self._bus.ask(request, urgency=urgency, weighs=True)
            except DeviceRefused as refused:
                if refused.code is None or exception(refused.code).meaning is Meaning.REFUSED:
                    raise
            await anyio.sleep(_REFUSED)
        return await self._bus.ask(request, urgency=urgency, weighs=True)

    def _free(self, fact: Fact) -> Request:
        """What to ask for a fact: where a late reply could be taken for its answer, something that tells it, too."""
        late = self._bus.owner.units[self._drive.address].late
        late.expire(self._bus.now())
        drive = self._drive

        def reading() -> Reading | None:
            return drive.reading(fact, lambda request: not late.must_wait(request)) or drive.reading(fact)

        preferred = said_by_family(drive.name, reading)
        assert preferred is not None
        return preferred.request

    def for_a_look(self, fact: Fact, unanswered: Mapping[bytes, Job]) -> tuple[Request, bool]:
        """What to ask for a fact; where a late reply could be taken for its answer, something else. And whether that
        tells it. What was `unanswered` may be sent again."""
        late = self._bus.owner.units[self._drive.address].late

        def free(request: Request) -> bool:
            return not late.in_order or not late.must_wait(request, unanswered.get(request.adu))

        reading = self._drive.reading(fact, free)
        if reading is not None:
            return reading.request, True
        others = (*(each.request for each in self._drive.readings), *self._drive.reads())
        return next((request for request in others if free(request)), others[0]), False


class AxisKnowledge:
    """What is known of one axis, for who is about to decide something.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
        questions: asks the drive.
        urgency: of what is asked.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        axis: int,
        name: str,
        questions: Questions,
        urgency: Urgency = Urgency.POLL,
    ) -> None:
        self.state: AxisState = drive.state.axes[axis]
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name
        self._questions = questions
        self._urgency = urgency

    async def know(self, facts: Iterable[Fact], *, since: float | None = None) -> None:
        """Have facts that were asked for since a time, or at least since the last frame that can have changed them.

        Raises:
            MotionError: the family's own code fails to say how they are asked for.
        """
        for fact in said_by_family(self._name, lambda: self._drive.tells(*facts)):
            for attempt in range(_ATTEMPTS):
                known = self.state.known(fact)
                told = known.value is not None or (attempt > 0 and known.at > NEVER)  # it may say nothing of it
                if told and (since is None or known.at >= since):
                    break
                await self._questions.ask(fact, since, self._urgency)

    async def afresh(self, *facts: Fact) -> None:
        """Ask for facts now."""
        await self.know(facts, since=self._bus.now())

    async def ask(self, fact: Fact) -> Any:
        """Ask for a fact now; what was told of it. Raises `NoReply` where its drive answers, and does not tell it."""
        oldest = self._bus.now() - FRESH
        await self.afresh(fact)
        known = self.state.last(fact)
        if known.at <= oldest:
            raise NoReply(f"{self._name}: its drive answers, and does not tell its {fact.value}.")
        return known.value

    async def stands(self) -> bool:
        """Whether the axis stands, as can be seen now.

        Raises:
            NoReply: its drive answers so slowly that it cannot be seen, while it is told to stop again and again, say;
                or it does not say where the axis is.
        """
        still, rule, oldest = self.state.standstill, self.state.rule, self._bus.now() - FRESH
        if still.verdict is True and still.until > oldest:
            return True
        await self.afresh(Fact.POSITION)
        longest, looks, over = FRESH, 0, self._bus.now() + _DOUBT_LASTS
        while still.is_in_doubt(longest) or still.until <= oldest:
            begun, looks = self._bus.now(), looks + 1
            halt = self._bus.owner.units[self._drive.address].halt
            if looks > _LOOKS and (begun > over or (halt is not None and halt.failed)):
                why = "does not say where it is" if still.until <= oldest else "answers too slowly"
                raise NoReply(f"{self._name}: it cannot be seen whether it stands. Its drive {why}.")
            if not still.confirmed:
                await self.know((Fact.RUNNING,), since=still.since)
            again = max(still.since + rule.apart, still.until + _LOOK_AGAIN)
            if still.until <= oldest:
                again = self._bus.now() + rule.apart  # its drive answers, and does not say where it is
            await anyio.sleep(max(0.0, again - self._bus.now()))
            await self.afresh(Fact.POSITION)
            # Where each answer takes its time, no two positions are closer together.
            longest = max(longest, _ROUND * (self._bus.now() - begun))
        return still.verdict is True

    async def see_restart(self, *facts: Fact) -> None:
        """Ask for what a restart would change, and for other facts, since the drive may have restarted last."""
        await self.know((*self._drive.marks(self._axis), *facts), since=self._drive.state.unsure_since(self._bus.now()))
        enabled = self.state.known(Fact.ENABLED)
        if enabled.value is False and self.state.holds:
            # A protection that let go of the motor explains that as well.
            await self.know((Fact.STALLED, Fact.FAULT), since=enabled.at)
        self.notice_restart()

    async def see_silence(self, *, by_reference: bool) -> None:
        """Find out whether the drive has restarted, where it has left something unanswered for long enough since that
        was asked last.

        Raises:
            ReferenceLost: it has; or positions were not to be trusted before, where it is to go `by_reference`.
        """
        state, lost, drive = self.state, self.state.lost, self._drive.state
        until = drive.unsure_since(self._bus.now()) if drive.was_busy else drive.silent_until
        is_older = any(state.last(fact).at < until for fact in self._drive.marks(self._axis))
        if is_older and not state.counts_anew:
            await self.see_restart()
        if by_reference or state.lost != lost:
            self.check_reference()

    async def see_put_off(self, start: int | None, target: int | None) -> None:
        """The same where its start is put off because the drive is busy. It stands at the start of its way, or has gone
        some of that to its target, if it has any.

        Raises:
            ReferenceLost: as `see_silence`.
        """
        self.state.between = None if start is None else (start, target)
        try:
            await self.see_silence(by_reference=target is not None)
        finally:
            self.state.between = None

    async def see_after_silence(self, *, heard: bool) -> None:
        """Find out whether the drive has restarted, if it is heard again. Raises `ReferenceLost` if it has."""
        if heard:
            try:
                await self.see_restart()
            except RequestFailed:
                pass
            except BusError:
                raise
            except Exception:
                _log.exception("%s: it cannot be judged whether its drive has restarted", self._name)
            else:
                self.check_reference()
                return
        if not self._drive.tells_restarts:
            self.state.suspect("its drive stopped answering and may have restarted.")

    def notice_restart(self) -> None:
        """Trust its positions no more, if what is known shows that the drive has restarted."""
        self.state.suspect(self._drive.restarted(self._axis))

    def check_reference(self) -> None:
        """Raise `ReferenceLost` where its positions are not to be trusted."""
        if self.state.lost:
            raise ReferenceLost(f"{self._name}: {self.state.lost} {LOST}")
