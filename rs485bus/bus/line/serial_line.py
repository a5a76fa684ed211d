"""The pair of wires as the owner sees it: whose turn it is, how long there was silence, what is out. Pure.

On a line that is never quiet (noise, a second master) a frame waits for silence in vain. A stop and the reads that
confirm it then go out over the noise, again and again: a slave that frames by silence hears the first that falls into a
gap, one that hunts for frames hears any.
"""

from __future__ import annotations

from collections.abc import Sequence

from rs485bus.bus.line.host_slack import HostSlack
from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.line.strangers import Strangers
from rs485bus.bus.line.transaction import Received, Transaction
from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.bus.units.motion import NEVER
from rs485bus.bus.units.reply_times import ReplyTimes
from rs485bus.wire.frames import MAX_FRAME, Request
from rs485bus.wire.timing import LineSettings

_STOPPING = (Urgency.STOP, Urgency.CONFIRM)
_STOP = 13
"""Bytes of most stops, at most."""
CUT_AFTER = 0.01
"""Seconds of silence after which a stop does not wait for a reply any longer. On a slow line a slave needs longer than
that to see the end of a frame."""
STOP_WAITS = 0.02
"""Seconds for which a stop waits for silence at most."""
LOOKS_WAIT = 0.25
"""Seconds for which the reads that confirm a stop do: a gap is waited for, if there are any."""
OTHERS_WAIT = 1.0
"""Seconds for which any other frame does."""
_NOISE = 0.005
"""Seconds without silence, and without an answer to what is out, that are noise."""
_RECENTLY = 1.0
"""Seconds for which a pair on which there was noise counts as noisy."""
_NOISY_WAITS = (0.01, 0.02, 0.04)
"""Seconds for which the answer to a stop is waited for on a noisy pair: in turns, so that the next one goes out at
another moment of whatever makes the noise. The last one is no shorter than the unit is known to take."""
_HELD_UP = 0.5
"""Seconds of noise, at most, that the wait for a reply may have seen. Some of it may have been the reply, torn."""
_BEGUN = 3
"""Bytes held that look like the reply which is waited for, and hardly are by chance."""


class SerialLine:
    """Silence, airtime and the one job that is out.

    The silence counts from the last byte received or from the end of the airtime of what was sent, whichever is
    later: a write call returning says nothing about the wire.

    Args:
        line: how characters travel.
        silence: seconds that must stand between two frames.
        echo: whether the adapter returns what is sent; None to find out.
        now: the time.
    """

    __slots__ = (
        "_brief_until",
        "_cut_after",
        "_deaf",
        "_first_byte_at",
        "_framed_at",
        "_gap_from",
        "_over_noise",
        "_turn",
        "air_end",
        "airtime",
        "character",
        "deadline",
        "exchange",
        "heard_at",
        "host",
        "is_brief",
        "job",
        "latency",
        "line",
        "noise_at",
        "noisy_since",
        "owed_until",
        "quiet_at",
        "silence",
        "strangers",
    )

    def __init__(self, line: LineSettings, silence: float, echo: bool | None, now: float) -> None:
        self.line = line
        self.character = line.character
        self.silence = silence
        self.exchange = Transaction(echo)
        self.strangers = Strangers()
        self.job: Job | None = None
        """The job that is out and may still be answered."""
        self.deadline = 0.0
        """When its reply budget is over."""
        self.owed_until = 0.0
        """Until when the unit may still answer; after the deadline others are served meanwhile."""
        self.airtime = 0.0
        """Seconds in which bytes were on the pair."""
        self.quiet_at = now + silence
        """When the next frame may start."""
        self.heard_at = NEVER
        """When the last bytes were received that may be noise."""
        self.noisy_since = now
        """Since when there was none but noise, or since when there may be."""
        self.noise_at = float("-inf")
        """When noise was last in the way of a frame."""
        self.latency = 0.0
        """Seconds for which the port may keep what it has received."""
        self.host = HostSlack()
        """How late this computer may be besides."""
        self.air_end = now
        """When what was sent last has left the wire."""
        self._cut_after = max(CUT_AFTER, 2 * silence + line.character)
        self._first_byte_at: float | None = None
        self._over_noise = False
        """What is out was not preceded by a silence."""
        self.is_brief = False
        """What is out is part of a stop on a noisy pair: it is not waited for long, if there is noise."""
        self._brief_until = 0.0
        self._framed_at = NEVER
        """When the last frame was received."""
        self._gap_from = 0.0
        """Until when an answer to that may begin though there was no noise for a while."""
        self._deaf = 0.0
        """Seconds since `heard_at` for which what is part of a stop was sent. Nobody listened then."""
        self._turn = 0

    @property
    def is_noisy(self) -> bool:
        """Whether there was noise where there should have been silence."""
        return self.heard_at > self.noisy_since + _NOISE

    @property
    def hears_noise(self) -> bool:
        """Whether what was heard last was no answer, nor looks like the begin of one, if a late one."""
        return self.heard_at > self._framed_at and self.exchange.pending < _BEGUN

    def has_noise(self, now: float) -> bool:
        """Whether there is noise now, and not a transaction."""
        heard = now < self.heard_at + self.silence
        return heard and self.is_noisy and (self.job is None or self._over_noise)

    def was_noisy(self, now: float) -> bool:
        """Whether there was noise of late."""
        return self.noise_at > now - _RECENTLY

    @property
    def through_noise_at(self) -> float:
        """When a frame may go out that waits for silence no longer. After a frame of our own there is silence."""
        return self.air_end + self.silence

    def begin(
        self, job: Job, start: float, reply_timeout: float, late: Sequence[PendingReplies], times: ReplyTimes
    ) -> None:
        """The job's frame goes out at `start`, to a unit that takes such `times` to answer."""
        request = job.request
        air = len(request.adu) * self.character
        self.airtime += air
        self._over_noise = start < self.quiet_at
        in_a_gap = self.hears_noise  # and not in the silence that follows a frame
        self.air_end = start + air
        self.quiet_at = self.air_end + self.silence
        self._first_byte_at = None
        self.exchange.begin(request, late)
        self.strangers.sent_or_answered(request.adu)
        self.is_brief = self._over_noise or (job.urgency in _STOPPING and self.was_noisy(start))
        if self.is_brief:
            wait, gap = _NOISY_WAITS[self._turn % len(_NOISY_WAITS)], _NOISE
            if wait == _NOISY_WAITS[-1]:
                gap = max(gap, times.expected(job)[1])
            self._gap_from, self._brief_until = self.air_end + gap, self.air_end + max(wait, gap)
            self._turn += 1
        if self.is_brief and (self._over_noise or in_a_gap):
            self._deaf += air
        else:
            self.noisy_since = self.air_end
        if not job.expects_reply:
            self.strangers.unanswered(request.adu, start)
        else:
            self.job = job
            takes = (request.length or MAX_FRAME) * self.character
            self.deadline = self.owed_until = self.air_end + reply_timeout + takes + self.latency

    def longest_wait(self, request: Request, reply_timeout: float) -> float:
        """Seconds from the start of a request within which its answer has come, or does not."""
        return self.line.budget(len(request.adu), reply_timeout, request.length or MAX_FRAME) + self.latency

    def is_out(self, now: float) -> None:
        """What was sent is out, as its answer tells, however long it was reckoned to take."""
        self.air_end = min(self.air_end, now)

    def feed(self, data: bytes, now: float) -> list[Received]:
        """Bytes were received; return the frames they complete."""
        self.airtime += len(data) * self.character
        follows_silence, listens_from = now >= self.quiet_at, max(now, self.air_end)
        if follows_silence or self.heard_at < self.noisy_since or now > self.heard_at + self._deaf + STOP_WAITS:
            self.noisy_since = listens_from  # what was heard before is over, whatever parts of a stop went out since
        self.heard_at = now
        if self._deaf:
            self._deaf = max(0.0, self.air_end - now)
        self.quiet_at = max(self.air_end, now) + self.silence
        if self._first_byte_at is None:
            self._first_byte_at = now
        received = self.exchange.feed(data)
        for _, _, frame in received:
            self.strangers.sent_or_answered(frame)
        if received:
            self._framed_at = now
            if passed := self.exchange.passed:
                self.strangers.heard(passed, now, follows_silence=True)
        elif self.job is None:
            self.strangers.heard(data, now, follows_silence=follows_silence)
        if received and not (self.is_brief and self._over_noise):
            self.noisy_since = listens_from  # a frame is no noise
        return received

    def wait_until(
        self, stop_asked_at: float | None = None, expected: tuple[float, float] = (0, 0), *, patient: bool = False
    ) -> float:
        """Until when the job that is out may still be answered.

        A stop, asked for at the time given, waits for no more than a silence; where there is none, not much longer. On
        a quiet pair it waits for an answer that is expected just then: that would fall into the stop, and destroy it.
        One that is `patient` waits for whatever is expected.
        """
        over = self.deadline
        if self.is_brief and (self._over_noise or self.heard_at > self.air_end):
            # In a gap a slave is heard at once, if it heard the frame; if not, the gap is for the next one.
            gap = max(self._gap_from, self.heard_at + self.silence)
            over = min(over, gap, self._unless_begun(self._brief_until))
        if stop_asked_at is None:
            return over
        shortest = self.air_end + self._cut_after + self.latency
        frees, takes = self._cut_after, self.line.airtime(_STOP)
        is_near = self.heard_at <= self.air_end and expected[0] < frees + takes
        if frees < expected[1] and (patient or is_near):
            longest = expected[1] if patient else min(expected[1], 2 * (frees + takes))
            shortest = max(shortest, self.air_end + longest + self.latency)
        noisy = self._unless_begun(max(shortest, stop_asked_at + STOP_WAITS))
        return min(over, noisy, max(shortest, self.heard_at + self._cut_after + self.latency))

    def _unless_begun(self, until: float) -> float:
        """The same time, or later where the answer may have begun: a long one only where it looks like that."""
        first, job = self._first_byte_at, self.job
        if first is None or job is None:
            return until
        takes = self.line.airtime(job.request.length or MAX_FRAME)
        return max(until, first + (takes if self.exchange.pending >= _BEGUN else min(takes, STOP_WAITS)))

    def end(self, late: Sequence[PendingReplies], now: float, *, answered: bool) -> None:
        """The job that was out was answered or given up."""
        if self.job is not None and not answered:
            self.strangers.unanswered(self.job.request.adu, now)
            if (heard := self.exchange.heard()) is not None:
                self.strangers.heard(heard.rest, now, follows_silence=True)
        self.job = None
        if not self.is_brief and answered:
            self.noisy_since, self.heard_at = now, NEVER  # what comes next is the first that may be noise
        elif not self.is_brief:
            self.noisy_since = max(self.noisy_since, now - _HELD_UP)
        self.is_brief = False
        self.exchange.idle(late)

    def restart(self, now: float) -> None:
        """The port was opened anew."""
        self.noisy_since, self.heard_at = now, NEVER
        self.air_end = max(self.air_end, now)  # the other end of a connection may be sending yet
        self.quiet_at = self.air_end + self.silence

    def record(self, job: Job, reply: bytes, outcome: str, now: float) -> tuple[Record, int]:
        """What this attempt of the job was, and how many CRC errors came with it."""
        skipped, crc_errors = self.exchange.counts()
        record = Record(
            job.address,
            job.urgency,
            job.attempts,
            job.request.adu,
            reply,
            skipped,
            job.queued_at,
            job.sent_at,
            self._first_byte_at,
            now,
            outcome,
        )
        return record, crc_errors
