"""How a device is brought to a stand: stop, see it stand, stop again. Pure.

A stop is never confirmed by its echo, only by reading, after it was sent, that the axis stands. A halt is not done
until that was read; after three stops in vain it says so and goes on more quietly.

A repetition is the same stop. A harder one follows where an acknowledged stop has not led to a stand in one and a half
times the time that it takes, or where two were not acknowledged, unless it is seen to slow down; or after three.

Procedures are generators that the owner drives: they yield what they wait for (a job, a time, a halt, other procedures)
and are resumed with what came of it. They belong to no task, so nothing can cancel them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar, Union

from rs485bus.bus.schedule.endings import Endings
from rs485bus.bus.schedule.job import Job, Outcome, Urgency, stop_job
from rs485bus.bus.stopping.pace import Pacing
from rs485bus.bus.units.adapter import DeviceAdapter, StandstillDetector
from rs485bus.bus.units.motion import NEVER, Motion
from rs485bus.wire.frames import Request

T = TypeVar("T")
_log = logging.getLogger("rs485bus")

Wanted = Union[Job, float, "Halt", Endings[Any]]
Procedure = Generator[Wanted, Any, T]

_FOREVER = float("inf")
STOPS = 3
"""Stop frames sent in vain before a halt is reported as not confirmed."""
_UNACKNOWLEDGED = 2
"""Stops in a row without an acknowledgement after which the next one is harder."""
_IN_TIME = 1.5
"""How many times the time that an acknowledged stop takes it is given."""
_MARGIN, _NOISY_MARGIN = 0.05, 0.5
_LOOK_EVERY = 0.02
_LOOKS = 6
"""Looks that one that acknowledged the stop has to be seen to stand, at least, however long each takes."""
_BLIND = 5
"""Stops, to a device that is not heard, of which one is followed by a look."""
_BLINDLY_EVERY = 0.5
"""Seconds that one has to stop in that cannot be judged."""
_ORDERS_EVERY = 0.1
"""Seconds after which a device that is left alone is stopped again if somebody asks for it."""


@dataclass(frozen=True, slots=True)
class Halted:
    """How a device ended up after it was told to stop."""

    address: int
    family: str
    standing: bool
    """It was read, after the stop, that it stands. False: look at the machine, use the hard-wired stop."""
    stops: int
    """How many stop frames were sent."""


class _Listener(NamedTuple):
    """Who is told how a halt ends."""

    tell: Callable[[Halted], None]
    asked_at: float
    stops: int
    """How many stops had been sent by then."""


def unconfirmed(devices: Iterable[DeviceAdapter]) -> list[Halted]:
    """How those devices ended up that may move still, when they are waited for no longer."""
    return [Halted(device.address, device.family, False, 0) for device in devices if device.motion.may_move]


class Halt:
    """One device being brought to a stand.

    Args:
        attached: the device.
        motion: the part of it to stop.
        emergency: as fast as it can, instead of with its ramp.
        now: the time.
        frames: the frames that stop it with its ramp; None for the family's own.
    """

    def __init__(
        self,
        attached: DeviceAdapter,
        motion: Motion,
        emergency: bool,
        now: float,
        frames: tuple[Request, ...] | None = None,
    ) -> None:
        self.attached = attached
        self.motion = motion
        self.emergency = emergency
        self.failed = False
        """The latest order was not confirmed in time. What would move the device is not sent before it is."""
        self.stops = 0
        self.told: Halted | None = None
        """How the latest order ended, once it has."""
        self._over = self._hardened = False
        self._now = self._ordered_at = now
        self._orders = 0
        self._said = -1
        """The order that was on the wire last, by its number."""
        self._frames = frames
        self._unacknowledged = self._in_vain = 0
        """Stops in a row that were not."""
        self._sent_at = NEVER
        self._evidence_from = _FOREVER
        """When the first stop of the latest order was sent: what was asked before shows nothing."""
        self._begun_at = _FOREVER
        """When the first stop of all was sent."""
        self._acknowledged = False
        self._is_heard = False
        """One frame of the last stop was acknowledged, if not all of them."""
        self._took = 0.0
        """Seconds that the last stop took on the wire."""
        self._said_so_at = NEVER
        """When it was last asked where its status said that it stands."""
        self._said_over_noise = False
        """That went out over noise, or noise came with its answer."""
        self._detector: StandstillDetector
        """Decides from all that was asked since the first stop: nothing sets it in motion between two orders."""
        self._looks: dict[Request, Job] = {}
        """What was asked and not answered. A look that is sent again is the same job: either reply to it will do."""
        self._listeners: list[_Listener] = []

    def listen(self, listener: Callable[[Halted], None]) -> None:
        """Be told once how the latest order ended: that it stands, or that three stops were not confirmed."""
        if self.told is not None:
            listener(self.told)
        else:
            self._listeners.append(_Listener(listener, self._ordered_at, self.stops))

    def again(self, motion: Motion, emergency: bool, now: float) -> tuple[Request, ...]:
        """It was told to stop once more. Returns the frames to send at once."""
        self._orders += 1
        self._ordered_at = now
        self.told = None
        self.failed = False
        self.emergency = self.emergency or emergency
        try:
            if motion is not self.motion:
                self.motion = self.attached.motion
                self._frames = None
                self._detector = self.attached.judgement(self.motion)
            return self._stop_frames()
        except Exception:
            _log.exception("unit %d is not told to stop at once: its family's own code failed", self.attached.address)
            return ()

    @property
    def is_said(self) -> bool:
        """Whether the latest order has been on the wire: what is said further is a repetition."""
        return self._said == self._orders

    def give_up(self) -> None:
        """Say that it was not seen standing, if nothing was said yet."""
        if self.told is None:
            self.failed = True
            self._tell(standing=False)

    def end(self) -> None:
        """Do no more about it."""
        self._over = True
        self.give_up()

    def run(self, pacing: Pacing) -> Procedure[bool]:
        """Stop it until it stands. False if that was ended before."""
        try:
            return (yield from self._stop_until_it_stands(pacing))
        except Exception:
            _log.exception("unit %d is stopped blindly: its family's own code failed", self.attached.address)
        while not self._over:
            order = self._orders
            yield from self._stop_blindly()
            self.give_up()
            while order == self._orders and not self._over:
                self._now = yield self._now + _ORDERS_EVERY
        return False

    def _stop_blindly(self) -> Procedure[None]:
        """Say it as often as one that is not seen to stand is told to. Nobody knows whether it stands then."""
        try:
            frames = self._stop_frames()
        except Exception:
            _log.exception("unit %d cannot be told to stop", self.attached.address)
            return
        for _ in range(STOPS):
            order = self._orders
            for request in frames:
                self._now = yield (stop := stop_job(request))
                if stop.attempts:
                    self._sent_at, self._said = stop.sent_at, order
            self.stops += 1
            self._now = yield self._now + _BLINDLY_EVERY

    def _stop_until_it_stands(self, pacing: Pacing) -> Procedure[bool]:
        self._detector = self.attached.judgement(self.motion)
        order, tries, said = self._orders, 0, 0
        while not self._over:
            if order != self._orders:
                order, tries, said, self._evidence_from = self._orders, 0, 0, _FOREVER
            cut = pacing.is_cut_short(self._now, self._ordered_at)
            yield from self._stop(pacing)
            tries, said = tries + (not cut), said + 1
            if self._is_worth_a_look(pacing) and (yield from self._see_it_stand(order, pacing)):
                self.failed = False
                self._tell(standing=True)
                return True
            if order != self._orders:
                self._tell_who_waited(pacing)
                continue
            in_vain = self._unacknowledged >= _UNACKNOWLEDGED or tries >= STOPS
            self._hardened = self._hardened or self._acknowledged or in_vain
            if tries >= STOPS or (cut and said >= STOPS and self._now >= self._ordered_at + pacing.gives_up_after):
                self.give_up()
            self._tell_who_waited(pacing)
            if self.told is not None:
                until = pacing.next_at(self._now, self._sent_at, self._acknowledged)
                others = self._now + self._took  # have their turns, too, however often it is heard again
                self._in_vain = 0 if self._acknowledged or self._wait(pacing) is not None else self._in_vain + 1
                if self._in_vain > 1:
                    until = max(until, others)  # it is heard, and waited for in full, again and again
                while self._now < until and order == self._orders and not self._over:
                    if self._now >= others and self._is_back(pacing):
                        break
                    self._now = yield min(until, others if self._now < others else self._now + _ORDERS_EVERY)
        return False

    def _is_back(self, pacing: Pacing) -> bool:
        """Whether it was heard again since a stop that it did not acknowledge: it is not left moving."""
        return not self._acknowledged and pacing.heard_at > self._sent_at

    @property
    def _is_hard(self) -> bool:
        return self.emergency or self._hardened

    def _stop_frames(self) -> tuple[Request, ...]:
        if self._is_hard:
            return tuple(self.attached.stop_frames(self.motion, True))
        if self._frames is None:
            self._frames = tuple(self.attached.stop_frames(self.motion, False))
        return self._frames

    def _stop(self, pacing: Pacing) -> Procedure[None]:
        """Say it once."""
        self._acknowledged, self._is_heard, order, heard = True, False, self._orders, True
        for request in self._stop_frames():
            self._now = yield (stop := stop_job(request, self._wait(pacing)))
            if stop.attempts:
                self._sent_at, self._said = stop.sent_at, order
                self._evidence_from = min(self._evidence_from, stop.sent_at)
                self._begun_at = min(self._begun_at, stop.sent_at)
            # An exception is no acknowledgement; what refuses a stop in its own way says that there is nothing to stop.
            # An answer that may be an older request's is none either.
            said_so = stop.outcome is Outcome.REPLY or (stop.outcome is Outcome.REFUSED and stop.code is None)
            heard = heard and said_so and stop.answered_since >= self._begun_at
            said_so = said_so and stop.answered_since >= self._evidence_from
            self._took = stop.ended_at - stop.sent_at
            self._acknowledged = self._acknowledged and said_so
            self._is_heard = self._is_heard or said_so
        self._detector.stop_sent()
        self.stops += 1
        # It heard one of the stops, whichever: it was only told to stop once more meanwhile.
        self._unacknowledged = 0 if heard else self._unacknowledged + 1

    def _is_worth_a_look(self, pacing: Pacing) -> bool:
        """Whether it may answer. One that is not heard is only told to stop, again and again."""
        if self._is_heard or not self._is_pressing(pacing):
            return True
        return not pacing.is_noisy(self._now) and (self.told is None or self.stops % _BLIND == 0)

    def _wait(self, pacing: Pacing) -> float | None:
        return pacing.reply_timeout(self._ordered_at, reported=self.told is not None)

    def _see_it_stand(self, order: int, pacing: Pacing) -> Procedure[bool]:
        """Look until it stands, or until it should be told to stop once more."""
        patience, heard, is_heard = self._now + self._patience, 0, self._is_heard
        # Also where stops to others leave no turn to its looks, it is told that it was not seen to stand.
        by = max(patience, self._now + pacing.looks_wait) if self.told is None else pacing.at_the_latest(self._sent_at)
        if self._will_do(pacing):
            return order == self._orders
        while order == self._orders and not self._over:
            look, standing = self._next_look(pacing, by), None
            if look is not None:
                self._now = yield look
                standing = self._judge(look, pacing)
            if standing:
                settled = self.attached.may_start_until(self.motion)
                if look is not None and look.answered_since >= settled:
                    return order == self._orders
                self._now = yield settled
                continue
            answered = look is not None and look.outcome is Outcome.REPLY
            heard += answered
            if standing is False and self._detector.slows_down:
                self._unacknowledged = 0
            # One that moves on did not hear the stop: it is said again without waiting for a ramp.
            elif not self._acknowledged and (standing is False or (not answered and self._is_pressing(pacing))):
                return False
            # On a noisy pair it may well stand, and not be heard to say so.
            margin = 0.0 if heard or not pacing.is_noisy(self._now) else _NOISY_MARGIN
            goes_on = self._acknowledged and standing is None and answered and heard < _LOOKS
            if self._now >= (by if goes_on else min(patience + margin, by)):
                return False
            # One that was heard just before is asked again at once: the line has lost that. Then others have turns.
            at_once = look is not None and (is_heard or pacing.is_noisy(self._now))
            is_heard = answered
            if not (self._detector.lacks_place if answered else at_once):
                self._now = yield self._now + _LOOK_EVERY
        return False

    @property
    def _patience(self) -> float:
        """Seconds for which it is looked before it is told to stop once more."""
        if self._acknowledged:
            return _IN_TIME * self.attached.stopping_time(self._is_hard)
        return self.attached.stopping_time(True) + _MARGIN

    def _is_pressing(self, pacing: Pacing) -> bool:
        """Whether one that does not answer is told to stop again at once."""
        return pacing.is_noisy(self._now) or self._wait(pacing) is not None

    def _next_look(self, pacing: Pacing, by: float) -> Job | None:
        """What to ask next, and not after the time given; None if a late reply could be taken for every answer."""
        weighs = not pacing.late.in_order

        def fresh(request: Request) -> bool:
            return weighs or pacing.late.must_wait(request) == 0

        def free(request: Request) -> bool:
            return pacing.late.must_wait(request, self._looks.get(request)) == 0

        # The answer to a fresh one was asked for now. On a noisy pair most that is owed was never heard.
        ask = self._detector.ask
        request = ask(free) if pacing.is_noisy(self._now) else ask(fresh) or ask(free)
        if request is None:
            return None
        look = self._looks.get(request)
        if look is None:
            look = Job(request, urgency=Urgency.CONFIRM, internal=True, retries=2 * weighs, weighs=weighs)
            if not weighs:
                self._looks[request] = look
        look.reply_timeout, look.expires_at = self._wait(pacing), None if by == _FOREVER else by
        # Once it was said that it could not be seen standing, others have their turns, too.
        look.urgency = Urgency.CONFIRM if self.told is None or pacing.is_noisy(self._now) else Urgency.COMMAND
        return look

    def _judge(self, look: Job, pacing: Pacing) -> bool | None:
        """Whether it stands, from what it answered; None if that is not known."""
        if look.outcome is Outcome.REPLY and look.answered_since >= look.sent_at:
            self._looks.pop(look.request, None)  # to ask once more is no repetition; else either answer will do
        if look.outcome is not Outcome.REPLY or look.answered_since < self._evidence_from:
            return None
        stands = self._detector.see(look.request, look.reply, look.answered_since)
        if stands and self._detector.by_status_alone:
            self._said_so_at, self._said_over_noise = look.answered_since, pacing.was_noisy_since(look.sent_at)
            return self._will_do(pacing) or None
        if stands is False:
            self._said_so_at = NEVER
        if stands and self._detector.by_position_alone and not self._acknowledged:
            return None  # what held it while it did not hear may let go
        return stands

    def _will_do(self, pacing: Pacing) -> bool:
        """Whether its status alone will do, which said that it stands: that it acknowledged the stop as well is enough
        for the owner over noise, and where many are stopped at once. Who asked for the stop looks further."""
        said_so_at = max(self._evidence_from, self.attached.may_start_until(self.motion))
        enough = self._said_over_noise or pacing.is_crowded(self._now)
        return self._acknowledged and enough and self._said_so_at >= said_so_at

    def _tell_who_waited(self, pacing: Pacing) -> None:
        """Tell those that it was not seen standing who have waited for long: a newer order is not to keep them."""
        asked_by = self._now - max(pacing.gives_up_after, STOPS * self._patience)
        stops = self.stops - STOPS
        waited = [each for each in self._listeners if each.asked_at <= asked_by and each.stops <= stops]
        if waited:
            self.failed = True
            self._tell_each(waited, self._halted(standing=False))

    def _tell(self, standing: bool) -> None:
        self.told = self._halted(standing)
        self._tell_each(self._listeners, self.told)

    def _halted(self, standing: bool) -> Halted:
        return Halted(self.attached.address, self.attached.family, standing, self.stops)

    def _tell_each(self, listeners: list[_Listener], told: Halted) -> None:
        self._listeners = [each for each in self._listeners if each not in listeners]
        for each in listeners:
            try:
                each.tell(told)
            except Exception:
                _log.exception("who was to be told how a stop ended failed")
