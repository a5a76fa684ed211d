"""Tells axes of a drive speeds, of which the newest counts. Nothing queues, and nothing but the wire delays it.

One frame waits at most, and a newer speed takes its place. The ramp is made here, in small steps, so that it is kept
whatever a drive makes of a new speed under way; each step is told with that ramp, too. Of several axes all change in
proportion, so that a vehicle keeps to its curve.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import ParamSpec

from rs485bus.bus.bus import Bus
from rs485bus.bus.failure import failure
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.schedule.timers import Wake
from rs485bus.motion.drive import Drive
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import Fact
from rs485bus.motion.terms import Speeds, Terms, scaled
from rs485bus.motion.told import Told
from rs485bus.motion.turns import Haste, Turns
from rs485bus.wire.exceptions import is_busy
from rs485bus.wire.frames import Request

P = ParamSpec("P")

STEP = 0.04
"""Seconds between two steps of a ramp."""
_AT_ONCE = 1.25 * STEP
"""Seconds of a ramp, at the most, that are told at once, where the line is not slower: a drive may jump."""
_GENTLER = 0.9
"""The part of the acceleration that a drive has at least, which is told the next gentler one."""
_AGAIN = 0.05
"""Seconds after which a speed is told again whose answer may have been that to another one."""
_MISSED = 3
"""Answers missed in a row after which one is waited for as long as the drive may take: it may have become slow."""
_FOREVER = float("inf")
_ENDS_WITHIN = 3.0
"""Seconds, beside twice those of the ramp, within which the end of a stream must be acknowledged."""
_SILENCE = (Outcome.NO_REPLY, Outcome.UNKNOWN)
_NO_MORE = (Reason.STOPPED, Reason.EMERGENCY, Reason.LATCHED, Reason.LOCKED, Reason.UNPLUGGED, Reason.CLOSED)
"""Why nothing can be told any more."""


class Streamer:
    """Tells axes of one drive speeds.

    Args:
        bus: the bus the drive is on.
        drive: the drive.
        axes: which ones of the drive.
        terms: what they keep to.
        speeds: how fast they turn already.
        noticed: called when something has happened that is no error, with what.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        axes: tuple[int, ...],
        terms: Terms,
        speeds: Speeds,
        noticed: Callable[[str], None],
    ) -> None:
        self.told = Told(speeds, bus.now() - STEP, [NEVER] * len(axes))
        self._ends_by = _FOREVER
        """When they should stand for good, though frames are lost."""
        self.refused = ""
        """Why the drive refuses what it is told."""
        self.failure: Exception | None = None
        """Why nothing can be told any more: the family's own code failed."""
        self._bus = bus
        self._drive = drive
        self._axes = axes
        self._terms = terms
        self._noticed = noticed
        self._states = tuple(drive.state.axes[axis] for axis in axes)
        self._motion = self._states[0].motion if len(axes) == 1 else drive.motion
        self._epoch = self._motion.epoch
        self._zero: Speeds = (0.0,) * len(axes)
        self._unit = bus.owner.units[drive.address]
        self._turns = bus.keep(Turns, Turns)
        self._wanted, self._wanted_at = speeds, bus.now()
        self._is_new = False
        """No frame was sent since the newest set-point."""
        self._expired = False
        self._job: Job | None = None
        self._heard = speeds
        """The last speeds that the drive has acknowledged."""
        self._next = speeds
        """The speeds that are being told, or were told last."""
        self._next_at = NEVER
        """When the set-point was given that they are told for; never for a mere step of a ramp."""
        self._carried_at = NEVER
        """When the frame was sent that carries them; never while it was not."""
        self._rest: deque[Request] = deque()
        """The frames that tell them, but for the one that is on its way and those before it."""
        self._has_begun = self._is_renewed = False
        """The first of them was sent; the one that carries the speed goes once more, with a newer set-point."""
        self._haste = Haste()
        self._is_unmistakable = True
        """No older answer can be taken for one to these frames."""
        self._missed = 0
        """Frames that were not answered since one was, in the time that the drive is known to take."""
        self._not_before = NEVER
        self._again_at = NEVER
        """When the drive is told once more what it may not have heard, if there is nothing newer."""
        self._wake = Wake(bus.call_at, self._go_on)
        self._over = False
        for state in self._states:
            state.ramp_stop = self._frames(self._zero)[-1]
        self._go_on()

    @property
    def is_on_its_way(self) -> bool:
        """Whether the speeds that count now are not told yet."""
        return self.told.speeds != self._target(self._bus.now())

    def want(self, *speeds: float) -> None:
        """A new set-point. What is too fast is cut, of all axes in proportion."""
        self._bus.check_thread()
        fastest = max(map(abs, speeds))
        self._wanted = scaled(speeds, min(1.0, self._terms.highest / fastest if fastest else 1.0))
        now = self._bus.now()
        self._haste.apart, self._wanted_at = now - self._wanted_at, now
        self._is_new, self._expired = True, False
        self._go_on()

    def end(self) -> None:
        """Slow down to a stand, for good."""
        if not self.ended:
            self._ends_by = self._bus.now() + 2 * self._terms.takes(self.told.speeds) + _ENDS_WITHIN
        self._go_on()

    def close(self) -> None:
        """Tell no more."""
        self._over = True
        if self._job is not None:
            self._bus.owner.cancel(self._job, self._bus.now())

    @property
    def ended(self) -> bool:
        """Whether they are slowing down to a stand, for good."""
        return self._ends_by < _FOREVER

    @property
    def is_quiet(self) -> bool:
        """Whether they have ended, and no frame of them is on its way."""
        return self.ended and self._job is None

    def hold(self, seconds: float) -> None:
        """Tell nothing for a while."""
        self._not_before = self._bus.now() + seconds
        self._wake.at(self._not_before)

    def insist(self) -> None:
        """Say it again: it was seen not to have been heard."""
        self.told.sure, self._again_at = False, NEVER
        self._go_on()

    @property
    def stands_at(self) -> float:
        """When they should stand, if they were told to; infinity if they were not."""
        return _FOREVER if any(self.told.speeds) else self.told.at + STEP + self._states[0].ramp_takes

    @property
    def ends_in_vain(self) -> bool:
        """Whether they were told to stand again and again, and the drive has never acknowledged that."""
        return not self.told.sure and self._bus.now() > self._ends_by

    # Which speeds are told next

    def _go_on(self) -> None:
        """Tell the next step, if there is one."""
        self._try(self._tell_next)

    def _try(self, do: Callable[P, None], *args: P.args, **kwargs: P.kwargs) -> None:
        """Do it. Where the family's own code fails, nothing can be told any more: who judges the stream ends it."""
        try:
            do(*args, **kwargs)
        except Exception as error:
            self.failure = error
            self.close()
            self._drive.state.tell()

    def _tell_next(self) -> None:
        if self._over:
            return
        if (now := self._bus.now()) < self._not_before:
            self._wake.at(self._not_before)  # it may have been woken for something else
            return
        target = self._target(now)
        step, told = self._step(target, now), self.told
        is_known = told.sure or now < self._again_at
        if self._job is not None:
            self._job.yields_until = self._yields_until  # what it is to say is seen when its turn comes
        elif step == told.speeds and is_known:
            self._is_new = False
            self._wake.at(min(self._changes_at(now, step != target), _FOREVER if told.sure else self._again_at))
        elif step != target and not self._is_new and is_known and now < told.at + STEP - 1e-6:
            self._wake.at(told.at + STEP)
        else:
            self._tell(step, now)

    def _target(self, now: float) -> Speeds:
        """The speeds that count now."""
        if self.ended:
            return self._zero
        if now < self._expires_at:
            return scaled(self._wanted, min(map(self._share_within, range(len(self._axes)))))
        expired, self._expired = self._expired, True
        if not expired and any(self._wanted):
            self._noticed(f"no set-point came for {self._terms.timeout:g} s: it was stopped by its ramp")
        return self._zero

    def _share_within(self, at: int) -> float:
        """The part of the wanted speed of an axis from which it still comes to a stand before a limit: by where it
        was, how old that is, and two attempts to tell it that fail."""
        limits = self._terms.limits[at] if self._terms.limits else None
        state, wanted, now = self._states[at], self._wanted[at], self._bus.now()
        position = state.last(Fact.POSITION)
        if limits is None or not wanted or position.value is None:
            return 1.0
        ahead = limits[1] - position.value if wanted > 0 else position.value - limits[0]
        ahead -= 2 * state.rule.same
        speed = max(abs(self.told.speeds[at]), abs(state.last(Fact.SPEED).value or 0.0))
        age, ramp = now - position.at, _GENTLER * self._terms.acceleration
        gone = speed * age + (ramp * age * age / 2 if math.isfinite(ramp) else 0.0)  # it may have been faster then
        room = max(0.0, 60 * ahead / self._drive.ability(self._axes[at]).counts_per_turn - gone)
        # What it goes until it can be told otherwise, and what it needs to stand, are to fit.
        blind = 2 * self._unit.reply_timeout + max(STEP, 2 * self._haste.every)
        allowed = ramp * (math.sqrt(blind * blind + 2 * room / ramp) - blind) if math.isfinite(ramp) else room / blind
        return min(1.0, allowed / abs(wanted))

    def _step(self, target: Speeds, now: float) -> Speeds:
        """The next speeds on the straight way to others."""
        told = self.told.speeds
        if not self._drive.turns_through_zero:
            # It comes to a stand first.
            target = tuple(0.0 if is_ * wanted < 0 else wanted for is_, wanted in zip(told, target, strict=True))
        step = self._terms.towards(target, told, min(max(now - self.told.at, 0.0), max(_AT_ONCE, self._haste.every)))
        if not self._drive.spreads_changes:
            return step
        # Of steps that it may not have heard it makes one, in the time that is for two.
        return self._terms.towards(step, self._heard, max(2 * STEP, self._haste.every))

    # Telling them

    def _frames(self, speeds: Speeds, *, afresh: bool = False) -> Sequence[Request]:
        """What tells these speeds."""
        by_axis = dict(zip(self._axes, speeds, strict=True))
        return self._drive.setpoints(by_axis, self._terms.acceleration, afresh=afresh)

    def _renew(self) -> None:
        """The turn of a frame has come: have it say the newest speeds, where that takes no more frames."""
        job, now = self._job, self._bus.now()
        assert job is not None
        if self._over or job.attempts or not (self._has_begun or self._is_newer):
            return
        speeds = self._step(self._target(now), now)
        if speeds == self._next:
            return
        frames = self._frames(speeds, afresh=not self.told.sure and not self._has_begun)
        fits = len(frames) <= 1 + len(self._rest) or not self._has_begun or self._carries_once_more()
        if fits and job.replace(frames[0]):
            self._take(frames[1:], speeds)
            self._heed_late(frames[0])

    def _tell(self, speeds: Speeds, now: float) -> None:
        told = self.told
        if told.sure and self._frames(speeds) == self._frames(told.speeds):
            # The drive cannot be told so small a step.
            told.speeds, told.at, self._is_new = speeds, now, False
            self._heard = speeds
            self._wake.at(now + STEP)
            return
        self._is_unmistakable, self._has_begun, self._is_renewed = True, False, False
        self._take(self._frames(speeds, afresh=not told.sure), speeds)
        self._haste.frames = frames = len(self._rest)
        self._submit(self._turns.urgency(self._bus, frames))

    def _carries_once_more(self) -> bool:
        """Whether the frame that carries the speed goes once more, with a newer set-point, before the drive is told to
        turn to it. It does so once."""
        once = self._is_newer and not self._is_renewed and self._haste.is_late(self._wanted_at, self._bus.now())
        self._is_renewed = self._is_renewed or once
        return once

    @property
    def _is_newer(self) -> bool:
        """Whether a set-point has come since the frames were made that tell one now."""
        return self._is_new and self._wanted_at > self._next_at

    @property
    def _yields_until(self) -> float:
        """Until when the next frame lets others go first whose turn it is. None comes between the first frame of a
        set-point and the one that carries it."""
        if not self._rest:
            return _FOREVER
        return NEVER if self._has_begun or not self._is_new else self._haste.yields_until(self._wanted_at)

    def _take(self, frames: Sequence[Request], speeds: Speeds) -> None:
        """These are to be sent."""
        self._rest, self._next = deque(frames), speeds
        self._next_at, self._carried_at = self._wanted_at if self._is_new else NEVER, NEVER

    def _submit(self, urgency: Urgency) -> None:
        request = self._rest.popleft()
        self._heed_late(request)
        self._job = Job(
            request,
            urgency=urgency,
            retries=0,
            setpoint=self._missed < _MISSED,
            goes_on=self._has_begun,
            yields_until=self._yields_until,
            moves=True,
            motion=self._motion,
            ignores_late_replies=True,
            on_turn=lambda: self._try(self._renew),
            on_end=lambda job: self._try(self._answered, job),
        )
        self._job.epoch = self._epoch  # whatever stops the axes ends the stream: nothing of it follows
        self._bus.submit(self._job)

    def _heed_late(self, request: Request) -> None:
        """See whether an older answer can be taken for that to a frame."""
        self._is_unmistakable = self._is_unmistakable and not self._unit.late.must_wait(request)

    def _answered(self, job: Job) -> None:
        self._job, busy = None, is_busy(job.code)  # that is no refusal: nothing was done, and it is told again
        if self._over:
            return
        if job.attempts:
            if not self._has_begun and job.outcome is Outcome.REPLY:
                self._haste.takes = job.ended_at - job.sent_at + self._bus.owner.pair.silence
            self._turns.last, self._has_begun = job, True
            self._carried_at = job.sent_at if self._carried_at == NEVER else self._carried_at
            if job.outcome in _SILENCE or busy:
                self._missed += 1
            elif job.answered_since == job.sent_at and not self._is_slow(job):
                self._missed = 0
            if not self._rest:
                self._was_sent(job.sent_at)
        now, refused = self._bus.now(), job.outcome is Outcome.REFUSED and not busy
        # One that refuses to stop in its own way says that it stands.
        stood = refused and job.code is None and job.request.adu == self._frames(self._zero)[0].adu
        if refused and not stood:
            self.close()
            self.refused = str(failure(job, self._bus.flight, self._drive.family))
            self._drive.state.tell()  # it is found out why
        elif job.outcome is Outcome.NOT_SENT and job.reason in _NO_MORE:
            self.close()  # who has ended it tells
        elif not job.attempts:
            self.hold(_AGAIN)
        elif job.outcome is Outcome.REPLY and self._rest:
            self._submit(Urgency.CONFIRM)
        else:
            answered = job.outcome is Outcome.REPLY or stood
            self.told.sure = answered and self._is_unmistakable
            self._heard = self.told.speeds if self.told.sure else self._heard
            self._again_at = now + _AGAIN if answered else NEVER
            self._not_before = now + _AGAIN if busy else self._not_before
            self._go_on()
            if self.is_quiet:
                self._drive.state.tell()

    def _is_slow(self, job: Job) -> bool:
        """Whether an answer took longer than the drive is known to take."""
        air = self._bus.owner.pair.line.airtime(len(job.request.adu) + len(job.reply))
        return job.ended_at - job.sent_at - air > self._unit.reply_times.wait(job, _FOREVER)

    def _was_sent(self, at: float) -> None:
        """The frame went out with which speeds count."""
        told = self.told
        for axis, (before, after) in enumerate(zip(told.speeds, self._next, strict=True)):
            if before * after <= 0:
                told.same_way_since[axis] = at
        told.speeds, told.at = self._next, at
        for state in self._states:
            state.ramp_takes = self._terms.takes(self._next)
        if self._next_at != NEVER:
            told.delay = self._carried_at - self._next_at
            told.count += 1
            self._is_new = self._wanted_at > self._next_at

    @property
    def _expires_at(self) -> float:
        return self._wanted_at + self._terms.timeout

    def _changes_at(self, now: float, on_its_way: bool) -> float:
        """When another speed may count though no set-point comes."""
        if self.ended or self._expired:
            return now + STEP if on_its_way else _FOREVER
        limited = self._terms.limits and any(self._wanted)
        return min(self._expires_at, now + STEP if on_its_way or limited else _FOREVER)
