"""One request on its way: what is asked, how urgent, how often it may be sent, and what became of it."""

from __future__ import annotations

import enum
import logging
from collections.abc import Callable

from rs485bus.bus.line.diagnosis import Heard
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.schedule.timers import Timer
from rs485bus.bus.schedule.verification import Verification
from rs485bus.bus.units.motion import Motion
from rs485bus.wire.frames import BROADCAST, Request
from rs485bus.wire.registers import Repeat

_log = logging.getLogger("rs485bus")

_FOREVER = float("inf")
NOT_WEIGHED = -1
"""Of a job that waits for late replies."""


class Urgency(enum.IntEnum):
    """Who goes first on the wire. A lower value goes before a higher one."""

    STOP = 0
    """Stops. They wait for nothing but the end of a frame."""
    START = 1
    """The frames that start a group, which go out as one. `AxisGroup` makes these."""
    FEED = 2
    """What keeps a watchdog fed."""
    CONFIRM = 3
    """The reads that confirm a stop. The bus makes these itself."""
    COMMAND = 4
    """What somebody asked for and waits for."""
    POLL = 5
    """What is asked again and again."""


class Outcome(enum.Enum):
    """The one way in which a job ends."""

    REPLY = "reply"
    REFUSED = "refused"
    NOT_SENT = "not sent"
    NO_REPLY = "no reply"
    UNKNOWN = "unknown"


class Reason(enum.Enum):
    """Why a job was not sent, or not sent again."""

    NONE = enum.auto()
    CANCELLED = enum.auto()
    """Its caller was."""
    EXPIRED = enum.auto()
    """Its time was over while others had the wire."""
    UNAWAITED = enum.auto()
    """It was sent, and its time was over before its device had to answer."""
    LINE_BUSY = enum.auto()
    """The line was never quiet."""
    ECHO = enum.auto()
    """Its time was over before it was known whether the adapter returns what is sent."""
    OWED = enum.auto()
    """Its time was over while a late reply of its device could have been taken for its answer."""
    STOPPING = enum.auto()
    """Its time was over while what it is meant for was being stopped."""
    UNCONFIRMED = enum.auto()
    """What it is meant for was told to stop three times, and could not be seen standing."""
    STOPPED = enum.auto()
    """What it is meant for was."""
    EMERGENCY = enum.auto()
    """An emergency stop flushed it, or the device was not seen standing after one."""
    LATCHED = enum.auto()
    """It could move something, and an emergency stop holds."""
    LOCKED = enum.auto()
    """It could move a device that was stopped for safety."""
    DISRUPTIVE = enum.auto()
    """Its device would be away for a while, and a watchdog is armed."""
    TOO_LONG = enum.auto()
    """It would take the wire for too long while a watchdog is armed."""
    BURST_TOO_LONG = enum.auto()
    """The frames that it goes out with would."""
    BROKEN_OFF = enum.auto()
    """It was to go out with others, and one of those was not sent or was refused."""
    OFFLINE = enum.auto()
    UNPLUGGED = enum.auto()
    QUEUE_FULL = enum.auto()
    CLOSED = enum.auto()


STOP, START, FEED, CONFIRM, COMMAND, POLL = Urgency
REPLY = Outcome.REPLY
NO_REASON = Reason.NONE
"""The members themselves, for what is asked of every frame: Python 3.11 takes 0.2 µs to look one up in its class."""


class Job:
    """A request and its way over the wire. The owner alone changes it after it was submitted.

    Args:
        request: the frame, and what may answer it.
        urgency: its place among the others.
        repeat: whether it may be sent again when no reply comes.
        moves: it could set a motor in motion. Such jobs are refused while the bus is latched.
        motion: what it is meant for; a stop of that drops the job.
        reply_timeout: seconds the device may take to answer; None for what the device or the bus is set to.
        pause: seconds of quiet on the pair before each attempt; None for what the device is set to.
        expires_at: when it must have ended, on the owner's clock.
        tolerant: its reply is no evidence of anything, so that it need not wait for late replies.
        internal: the bus' own; neither flushed nor refused because of the state of the device or the bus.
        retries: how often it may be repeated; None for what the bus is set to.
        setpoint: it is of a stream: something newer will be said. Its answer is waited for no longer than the device
            usually takes, though it is not repeated, and no queue is too full for it.
        weighs: it is a read that is asked again and again, without waiting for late replies that look like its own,
            until its answer has come more often than those can. Only where replies may overtake each other.
        goes_on: it goes on with what was begun, before others of its urgency.
        yields_until: from when on it goes before those whose turn it is, as what has waited for too long.
        backs_off: it is repeated less and less often: the device may be busy, and nobody waits for the answer itself.
        slot: its place among frames that go out as one, whatever its urgency; None for a frame of its own.
        verify: how to see whether it was carried out, where it may be sent again once that shows that it was not.
        on_turn: called when its turn to be sent has come: it may be replaced by something newer then.
        on_end: called once with the job when it has ended.
    """

    __slots__ = (
        "address",
        "answered_since",
        "attempts",
        "backs_off",
        "caller_cancelled",
        "code",
        "cuts",
        "ended_at",
        "epoch",
        "expects_reply",
        "expires_at",
        "feeds",
        "goes_on",
        "heard",
        "held_up_since",
        "ignores_late_replies",
        "internal",
        "is_broadcast",
        "motion",
        "moves",
        "not_before",
        "on_end",
        "on_turn",
        "outcome",
        "patient_until",
        "pause",
        "queued_at",
        "read_back",
        "read_backs",
        "reason",
        "repeat",
        "reply",
        "reply_timeout",
        "request",
        "retries",
        "sent_at",
        "setpoint",
        "slot",
        "timer",
        "unanswered",
        "urgency",
        "verify",
        "weighed",
        "yields_until",
    )

    def __init__(
        self,
        request: Request,
        *,
        urgency: Urgency = Urgency.COMMAND,
        repeat: Repeat = Repeat.SAFE,
        moves: bool = False,
        motion: Motion | None = None,
        reply_timeout: float | None = None,
        pause: float | None = None,
        expires_at: float | None = None,
        ignores_late_replies: bool = False,
        internal: bool = False,
        retries: int | None = None,
        setpoint: bool = False,
        weighs: bool = False,
        goes_on: bool = False,
        yields_until: float = _FOREVER,
        backs_off: bool = False,
        slot: BurstSlot | None = None,
        verify: Verification | None = None,
        on_turn: Callable[[], None] | None = None,
        on_end: Callable[[Job], None] | None = None,
    ) -> None:
        self.request = request
        self.address = request.address
        self.is_broadcast = request.address == BROADCAST
        self.expects_reply = request.length > 0 or request.sizer is not None
        if slot is not None:
            urgency = START
        elif urgency is START:
            urgency = COMMAND  # there is nothing that it could go out with
        self.urgency = urgency
        self.repeat = repeat
        self.moves = moves
        self.motion = motion
        self.epoch = 0 if motion is None else motion.epoch
        self.reply_timeout = reply_timeout
        self.pause = pause
        self.expires_at = expires_at
        self.ignores_late_replies = ignores_late_replies
        self.internal = internal
        self.retries = retries
        self.setpoint = setpoint
        self.weighed = 0 if weighs else NOT_WEIGHED
        """Attempts whose answer did not decide."""
        self.goes_on = goes_on
        self.yields_until = yields_until
        self.backs_off = backs_off
        self.slot = slot
        self.verify = verify
        self.read_back: Job | None = None
        """The read-back that is waited for, while the write itself waits for its outcome."""
        self.read_backs = 0
        self.on_turn = on_turn
        self.on_end = on_end
        self.timer: Timer | None = None
        """What ends it when its time is over."""
        self.queued_at = 0.0
        self.sent_at = 0.0
        """When its latest attempt was sent."""
        self.held_up_since = 0.0
        """Since when a late reply keeps it from being sent; 0 if none ever did."""
        self.not_before = 0.0
        """When the device can be asked again that said it was busy."""
        self.ended_at = 0.0
        self.answered_since = 0.0
        """When the oldest attempt was sent that its reply may answer."""
        self.patient_until = 0.0
        """Until when it is repeated, however often: its attempts did not take as long as they may."""
        self.attempts = 0
        self.unanswered = 0
        self.cuts = 0
        """Attempts that do not count: a stop did not wait for their answer, or a late reply may have destroyed them."""
        self.feeds = False
        """Its latest attempt was sent to feed a watchdog."""
        self.caller_cancelled = False
        """Nobody waits for it any more."""
        self.heard: Heard | None = None
        """What came instead of an answer, in the latest attempt in which anything did."""
        self.outcome: Outcome | None = None
        self.reason = NO_REASON
        self.reply = b""
        self.code: int | None = None
        """The exception code that answered its latest attempt, if one did."""

    def take_turn(self) -> None:
        """Its turn has come: it may say something newer. It goes out whatever becomes of that."""
        if self.on_turn is not None:
            try:
                self.on_turn()
            except Exception:
                _log.exception("what was to be called when the turn of a request came failed: %s", self.request)

    def replace(self, request: Request) -> bool:
        """Have it say something newer, if it was never sent. False if it is too late."""
        if self.outcome is not None or self.attempts:
            return False
        self.request = request
        return True

    @property
    def goes_first(self) -> bool:
        """Whether it goes before others of its urgency to its device."""
        return self.goes_on or (self.urgency is CONFIRM and self.yields_until < _FOREVER)

    @property
    def is_look(self) -> bool:
        """Whether it looks at what moves, or is being stopped."""
        return self.urgency is Urgency.CONFIRM and not self.request.writes

    @property
    def is_repeatable(self) -> bool:
        """Whether it does no harm to send it again where it may have arrived."""
        safe = self.repeat is Repeat.SAFE or not self.request.writes
        return safe and self.slot is None and self.expects_reply

    @property
    def is_stale(self) -> bool:
        """Whether what it is meant for was stopped since it was made. A stop never is."""
        motion = self.motion
        return motion is not None and motion.epoch != self.epoch and self.urgency is not Urgency.STOP


def stop_job(request: Request, reply_timeout: float | None = None) -> Job:
    """One of the bus' own stops, which waits for no late reply."""
    return Job(
        request,
        urgency=Urgency.STOP,
        reply_timeout=reply_timeout,
        ignores_late_replies=True,
        internal=True,
        retries=0,
    )
