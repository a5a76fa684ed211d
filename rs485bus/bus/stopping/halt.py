"""How a device is brought to a stand: stop, see it stand, stop again. Pure.

A stop is never confirmed by its echo, only by reading, after it was sent, that the axis stands. A halt is not done
until that was read; after three stops in vain it says so and goes on more quietly.

Procedures are generators that the owner drives: they yield what they wait for (a job, a time, a halt, other procedures)
and are resumed with what came of it. They belong to no task, so nothing can cancel them.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar, Union

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.endings import Endings
from rs485bus.bus.schedule.job import Job, Outcome, Urgency
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.units.motion import NEVER, Motion
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Repeat

T = TypeVar("T")
Wanted = Union[Job, float, "Halt", Endings[Any]]
Procedure = Generator[Wanted, Any, T]

STOPS = 3
"""Stop frames sent in vain before a halt is reported as not confirmed."""
_LOOK_EVERY = 0.02
_ORDERS_EVERY = 0.1
"""Seconds after which a device that is left alone is stopped again if somebody asks for it."""
_TRY_AGAIN_AFTER = 0.5
_MARGIN = 0.05


@dataclass(frozen=True, slots=True)
class Halted:
    """How a device ended up after it was told to stop."""

    address: int
    family: str
    standing: bool
    """It was read, after the stop, that it stands. False: look at the machine, use the hard-wired stop."""
    stops: int
    """How many stop frames were sent."""


def unconfirmed(devices: Iterable[DeviceAdapter]) -> list[Halted]:
    """How those devices ended up that may move still, when they are waited for no longer."""
    return [Halted(device.address, device.family, False, 0) for device in devices if device.motion.may_move]


class Halt:
    """One device being brought to a stand.

    Args:
        attached: the device.
        motion: the part of it to stop.
        emergency: as fast as it can, instead of with its ramp.
        frames: the frames to begin with; None for the family's own.
    """

    def __init__(
        self, attached: DeviceAdapter, motion: Motion, emergency: bool, frames: tuple[Request, ...] | None = None
    ) -> None:
        self.attached = attached
        self.motion = motion
        self.emergency = emergency
        self.failed = False
        """Three stops in a row were not confirmed."""
        self.stops = 0
        self._frames = frames
        self._orders = 0
        self._sent_at = NEVER
        self._acknowledged = False
        self._listeners: list[Callable[[Halted], None]] = []
        self.told: Halted | None = None
        """How the latest order ended, once it has."""

    def listen(self, listener: Callable[[Halted], None]) -> None:
        """Be told once how the latest order ended: that it stands, or that three stops were not confirmed."""
        if self.told is not None:
            listener(self.told)
        else:
            self._listeners.append(listener)

    def again(self, motion: Motion, emergency: bool) -> tuple[Request, ...]:
        """It was told to stop once more. Returns the frames to send at once."""
        self._orders += 1
        self.told = None
        if motion is not self.motion:
            self.motion = self.attached.motion
        self.emergency = self.emergency or emergency
        self._frames = None
        return self._stop_frames()

    def run(self, late: PendingReplies, pause: Callable[[float], float]) -> Procedure[None]:
        """Stop it until it stands.

        Args:
            late: what the device owes.
            pause: given the time, until when to leave the device alone after three stops in vain.
        """
        now, order, tries = 0.0, self._orders, 0
        while True:
            if order != self._orders:
                order, tries = self._orders, 0
            for request in self._stop_frames():
                stop = Job(request, urgency=Urgency.STOP, ignores_late_replies=True, internal=True, retries=0)
                now = yield stop
                self._sent_at = stop.sent_at
                self._acknowledged = stop.outcome in (Outcome.REPLY, Outcome.REFUSED)
            self.stops += 1
            tries += 1
            if (yield from self._see_it_stand(order, now, late)):
                self._tell(standing=True)
                return
            if order == self._orders and tries == STOPS:
                tries = 0
                self.failed = True
                self._tell(standing=False)
                until = max(now + _TRY_AGAIN_AFTER, pause(now))
                while now < until and order == self._orders:
                    now = yield min(until, now + _ORDERS_EVERY)

    def _stop_frames(self) -> tuple[Request, ...]:
        if self._frames is not None and not self.emergency and self.stops == 0:
            return self._frames
        # A ramp that was not confirmed is not trusted a second time.
        return tuple(self.attached.stops(self.motion, self.emergency or self.stops > 0))

    def _see_it_stand(self, order: int, now: float, late: PendingReplies) -> Procedure[bool]:
        attached = self.attached
        judge = attached.judgement(self.motion)
        patience = now + attached.stopping_time(self.emergency or self.stops > 1) + _MARGIN
        asked: dict[Request, Job] = {}

        def free(request: Request) -> bool:
            return late.must_wait(request, asked.get(request)) == 0

        while order == self._orders:
            request = judge.ask(free)
            if request is not None:
                look = asked.get(request)
                if look is None:
                    look = asked[request] = Job(
                        request, urgency=Urgency.CONFIRM, repeat=Repeat.SAFE, internal=True, retries=0
                    )
                now = yield look
                if look.outcome is Outcome.REPLY and look.answered_since >= self._sent_at:
                    attached.told(request, look.reply, look.answered_since)
                    standing = judge.see(request, look.reply, look.answered_since)
                    settled = attached.may_start_until(self.motion)
                    if standing and look.answered_since >= settled:
                        return order == self._orders
                    if standing is False and not self._acknowledged:
                        return False  # the stop was lost: say it again without waiting for a ramp
                    if standing:
                        now = yield settled
                        continue
            if now >= patience:
                return False
            now = yield now + _LOOK_EVERY
        return False

    def _tell(self, standing: bool) -> None:
        listeners, self._listeners = self._listeners, []
        self.told = Halted(self.attached.address, self.attached.family, standing, self.stops)
        for listener in listeners:
            listener(self.told)
