"""Requests that are awaited: from the call to the reply, or to the error that says what became of it."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import TypedDict, Unpack

from rs485bus.bus.failure import failure
from rs485bus.bus.handle import settle
from rs485bus.bus.owner import Owner
from rs485bus.bus.port import Port
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.schedule.job import REPLY, Job, Urgency
from rs485bus.bus.schedule.verification import Verification
from rs485bus.bus.units.broadcast import is_broadcast, moved_by
from rs485bus.bus.units.motion import Motion
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Repeat


class JobOptions(TypedDict, total=False):
    """How a request is sent."""

    urgency: Urgency
    """Its place among the others; COMMAND if nothing is said."""
    repeat: Repeat
    """Whether it may be sent again when no reply comes; SAFE if nothing is said."""
    moves: bool
    """It could set a motor in motion."""
    motion: Motion | None
    """What it is meant for; a stop of that drops it."""
    reply_timeout: float | None
    """Seconds that the device may take to begin an answer."""
    pause: float | None
    """Seconds of quiet on the pair before each attempt."""
    slot: BurstSlot | None
    """Its place among frames that go out as one."""
    weighs: bool
    """It is asked again, without waiting for late replies, until its answer can be none (`Job`)."""
    verify: Verification | None
    """How to see whether it was carried out."""


class AskOptions(JobOptions, total=False):
    """How a request is sent, and how long it is waited for."""

    timeout: float | None
    """Seconds from the call to the end of the last repetition; None for no limit."""
    family: str | None
    """The family that a broadcast is meant for."""


class Requests:
    """Sends requests and waits for what becomes of them.

    Args:
        owner: the machine.
        port: its port, which may know why nobody answers.
        submit: takes a job.
    """

    def __init__(self, owner: Owner, port: Port, submit: Callable[[Job], None]) -> None:
        self._owner = owner
        self._port = port
        self._submit = submit

    async def ask(
        self,
        request: Request,
        timeout: float | None = None,
        family: str | None = None,
        **options: Unpack[JobOptions],
    ) -> bytes:
        """Send a request; return the frame that answers it. Raises as described at `Unit`.

        One with a `slot` goes out with others, as one, and as what starts a group. With `verify` and `repeat=VERIFY` a
        write that is not answered is read back, and repeated where that shows that it was not carried out; empty is
        returned where that shows that it was.

        Raises:
            BroadcastConflict: a broadcast is a read, or a device of another family would act on it.
        """
        owner, loop = self._owner, asyncio.get_running_loop()
        unit = owner.units[request.address]
        attached = unit.attached
        if is_broadcast(request):
            options["moves"], options["motion"] = True, moved_by(request, owner.units, family)
        elif options.get("moves") and options.get("motion") is None and attached is not None:
            options["motion"], options["moves"] = attached.motion, unit.may_be_moved_by(request)
        ended = loop.create_future()
        expires_at = None if timeout in (None, math.inf) else loop.time() + timeout
        job = Job(request, expires_at=expires_at, on_end=lambda _: settle(ended, None), **options)
        self._submit(job)
        if job.outcome is None:
            try:
                await ended
            except asyncio.CancelledError:
                owner.cancel(job, loop.time())
                raise
        if job.outcome is REPLY:
            return job.reply
        of, refusals = (None, None) if attached is None else (attached.family, attached.refusals)
        flight = list(owner.journal.flight)
        raise failure(job, flight, of, self._port.trouble, self._port.advice, unit.explain, refusals)
