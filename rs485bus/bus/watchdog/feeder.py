"""What is sent to feed a watchdog: a request that waits for the device anyway, or else a read of its own. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter

from rs485bus.bus.schedule.job import FEED, Job
from rs485bus.bus.schedule.queue import Admission, Queue
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.units.unit_states import UnitStates
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, Feeding
from rs485bus.wire.frames import Request

_NOT_NOW = float("inf")
_length = attrgetter("length")
_BRIEFEST = 0.001
"""Seconds for which the answer to a feed is waited for at the least."""


def next_feed(
    watch: ArmedWatchdog, feeding: Feeding, queue: Queue, units: UnitStates, admit: Admission, now: float
) -> Job:
    """What to send to a device that is due.

    On a bus that is never idle something waits for most devices. It goes a little before its turn, instead of in
    addition to a feed, so that feeding takes nothing from the wire. What was not answered is followed by a feed.

    Args:
        watch: the watchdog that is due.
        feeding: all of them.
        queue: what waits for the wire. What goes is taken out of it.
        units: the addresses.
        admit: whether a job may go.
        now: the time, in seconds.
    """
    unit = units.by_address[watch.address]
    wait = feeding.wait(watch, now)
    in_full = wait >= watch.attempt
    if queue.size and watch.failures == 0 and in_full:
        waiting = queue.take_of(watch.address, lambda job: admit(job) if _is_as_short(job, unit) else _NOT_NOW)
        if waiting is not None:
            waiting.feeds = True
            return waiting
    unit.expire(now)
    request = _read_to_feed(unit, unit.reads(), queue) if unit.late.owed else unit.reads()[0]
    watch.ledger.feeds += 1
    job = Job(request, urgency=FEED, ignores_late_replies=True, internal=True, retries=0)
    job.feeds = True
    # A device that has become slow is to be heard: it is waited for longer than it usually takes, unless others would
    # trip for that.
    waits = unit.reply_timeout if in_full else max(_BRIEFEST, wait - watch.overhead)
    job.reply_timeout = min(waits, unit.reply_timeout)
    return job


def _read_to_feed(unit: UnitState, reads: Sequence[Request], queue: Queue) -> Request:
    """What to ask a device that owes replies: one whose reply is not owed, or else one that proves less.

    It is none whose answer could be taken for one that somebody waits for, who would wait for longer if it were lost.
    Where nothing ends that but time, an answer to what is owed makes it owed for longer, too: it is the least telling
    read then.
    """
    harmless = queue.keeping_nobody_waiting(unit.address, reads) or reads
    if unit.late.in_order:
        return min((read for read in harmless if not unit.late.must_wait(read)), key=_length, default=harmless[0])
    return harmless[-1]


def _is_as_short(job: Job, unit: UnitState) -> bool:
    """Whether it takes the wire no longer than a feed may."""
    longest = max(len(read.adu) + read.length for read in unit.reads())
    length = job.request.length
    return job.reply_timeout is None and 0 < length <= longest - len(job.request.adu)
