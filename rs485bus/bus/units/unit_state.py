"""What the owner knows of each address: its device, what it owes, whether it answers, whether it is being stopped."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Concatenate, Literal, ParamSpec, TypeVar

from rs485bus.bus.line.numbered import NumberedReplies
from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.endings import Endings
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.stopping.halt import Halt
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.units.motion import NEVER
from rs485bus.bus.units.probing import AnsweredRequests
from rs485bus.bus.units.reachability import Reachability
from rs485bus.bus.units.reply_times import ReplyTimes
from rs485bus.bus.watchdog.armed import Ledger
from rs485bus.wire.diagnostics import Diagnostic, diagnostic
from rs485bus.wire.exceptions import Meaning, exception
from rs485bus.wire.frames import HIGHEST_ADDRESS, Request

P = ParamSpec("P")
T = TypeVar("T")

_log = logging.getLogger("rs485bus")

_LONGEST_WINDOW = 5.0
"""Seconds to which a window grows by itself."""
_LONGER = 1.5
"""How many times as long as it was a window becomes at least: it grows few times, each of which is told."""

SILENT = 2
"""Attempts in a row without an answer after which a device is hardly there."""


class UnitState:
    """One address on the pair."""

    __slots__ = (
        "_failing",
        "_reads",
        "address",
        "answers",
        "asked_in_vain",
        "attached",
        "former",
        "halt",
        "heard_at",
        "is_questioned",
        "is_stops_only",
        "kept_silent",
        "lapsed",
        "late",
        "late_reply_window",
        "ledger",
        "locked",
        "may_be_armed",
        "misheard_at",
        "misses_count_from",
        "pause",
        "probe",
        "question",
        "reach",
        "rearm",
        "reply_timeout",
        "reply_times",
        "restoring",
        "silent_since",
        "silent_until",
        "stood",
        "unheard_until",
        "watchdog_ms",
    )

    def __init__(
        self, address: int, in_order: bool, reply_timeout: float, late_reply_window: float, native: bool = False
    ) -> None:
        self.address = address
        self.reply_timeout = reply_timeout
        self.late_reply_window = late_reply_window
        self.pause = 0.0
        """Seconds of quiet on the pair before a request to it, where it wants more than the others."""
        self.probe: Request | Literal[False] | None = None
        """The read that it may be asked to see whether it answers; False for none, None where nobody has said."""
        self.attached: DeviceAdapter | None = None
        self.late = NumberedReplies() if native else PendingReplies(in_order)
        self.reach = Reachability()
        self.heard_at = NEVER
        """When it was last heard, in time or late."""
        self.reply_times = ReplyTimes()
        self.question: Job | None = None
        """What it was asked last instead of waiting for a reply that it owes."""
        self.is_questioned = False
        """That is under way."""
        self.misses_count_from = NEVER
        """An attempt sent earlier is no further evidence of its silence: it may be busy for as long as it may take."""
        self.halt: Halt | None = None
        """The stop that is not confirmed yet."""
        self.answers = AnsweredRequests()
        self.is_stops_only = False
        """Nothing but stops until it stands: neither polled nor fed."""
        self.asked_in_vain = 0
        """Attempts in a row that were not answered, those cut short for a stop included."""
        self.silent_since = NEVER
        """When the first of them was made."""
        self.unheard_until = NEVER
        """Until when it was listened for in vain."""
        self.kept_silent = 0.0
        """Seconds for which its latest silence lasted at least that was longer than its reply may take."""
        self.silent_until = NEVER
        """No frame at all before this time."""
        self.locked = ""
        """Why it moves only after it was enabled again; empty if it need not be."""
        self.lapsed = False
        """Its lease was not renewed, nor has it been since."""
        self.stood = False
        """It stood when its lease lapsed: to renew that is enough."""
        self.rearm: float | None = None
        """The watchdog time, in seconds, to feed it by again when it is enabled: it may have tripped."""
        self.ledger: Ledger | None = None
        """How it was fed in the watchdog block that holds it; None if none does."""
        self.may_be_armed = False
        """A watchdog block has set its register, or has tried to, and has not restored it since."""
        self.restoring: Endings[None] | None = None
        """Its register is being restored; that is what it waits for."""
        self.former: int | None = None
        """What its register held before that, in ms; None if that is not known."""
        self.misheard_at = NEVER
        """When it last answered what its device could not take in."""
        self._failing: set[str] = set()
        """The hooks of its device that have failed."""
        self._reads: Sequence[Request] = ()
        """What its device named last."""
        self.watchdog_ms: int | None = None
        """What this bus wrote into its register last, in ms, if the device took it; None if that is not known."""

    def is_silent(self, now: float) -> bool:
        """Whether it has answered none of its latest attempts, and had time for it."""
        return self.asked_in_vain >= SILENT and now >= self.silent_since + self.reply_timeout

    def unheard(self, since: float, now: float, attempts: int = 1) -> None:
        """So many attempts, the first one at `since`, were not answered."""
        self.silent_since = min(self.silent_since, since) if self.asked_in_vain else since
        self.asked_in_vain += attempts
        self.unheard_until = now

    def ends_silence(self, now: float) -> None:
        """It is heard. A silence that was longer than its reply may take is its own, and not the line's."""
        self.asked_in_vain = 0
        if now - self.silent_since > self.reply_timeout:
            self.kept_silent = self.unheard_until - self.silent_since

    def waits(self, job: Job, retries: int) -> int:
        """For how many times its reply timeout a job is repeated until it is given up: as many as it has attempts. A
        read of a plain unit whose latest silence outlasted that waits for one."""
        attempts = 1 + (retries if job.retries is None else job.retries)
        outlasted = self.kept_silent > attempts * self.reply_timeout
        is_plain = self.attached is None and job.expires_at is None and not job.request.writes
        return 1 if outlasted and is_plain else attempts

    @property
    def leaves_questions(self) -> bool:
        """Whether a plain unit was heard no more since it left unanswered what it was asked instead of waiting. What a
        drive's silence means is judged by time."""
        asked = self.question
        if asked is None or self.attached is not None:
            return False
        return asked.unanswered > 0 and asked.sent_at > self.heard_at

    def expire(self, now: float) -> None:
        """Forget what can arrive no more. A plain unit that is silent may be at what it was asked first: what it was
        asked since comes after that, later than replies come else."""
        if self.leaves_questions:
            self.late.prolong(now + self.late_reply_window, _LONGEST_WINDOW)
        self.late.expire(now)

    @property
    def guarded(self) -> bool:
        """Whether a watchdog block holds it."""
        return self.ledger is not None

    def answered_late(self, after: float) -> None:
        """A reply came so many seconds after its request. One near the end of the window makes that longer: the next
        may come later yet, and would be taken for the answer to something else."""
        late = after - self.reply_timeout
        window = min(_LONGEST_WINDOW, 2 * late)
        if late > self.late_reply_window / 2 and window > _LONGER * self.late_reply_window:
            self.late_reply_window = window
            _log.warning(
                "Unit %d answered %.2f s after it was asked: from now on its late replies are expected for %.2f s "
                "(late_reply_window=%.1f says so from the start)",
                self.address,
                after,
                window,
                window,
            )

    def attach(self, attached: DeviceAdapter | None) -> None:
        """A device is known at this address, with timing of its own if it has any."""
        self._reads = () if attached is None else attached.reads()
        self.attached = attached
        if attached is not None and attached.reply_timeout is not None:
            self.reply_timeout = attached.reply_timeout
        if attached is not None and attached.late_reply_window is not None:
            self.late_reply_window = max(self.late_reply_window, attached.late_reply_window)

    def tell_reply(self, request: Request, reply: bytes, asked_at: float, now: float) -> None:
        """Tell its device that it has answered."""
        if self.attached is None:
            return
        try:
            self.attached.on_reply(request, reply, asked_at, now)
        except Exception:
            self.misheard_at = now
            self._note_failure("on_reply", reply.hex(" "))

    def tell(self, hook: Callable[P, None], *args: P.args, **kwargs: P.kwargs) -> None:
        """Tell its device something. That the device's own code fails keeps nobody from what follows."""
        try:
            hook(*args, **kwargs)
        except Exception:
            self._note_failure(getattr(hook, "__name__", "a hook"))

    # What its device says of requests. Where its own code fails in that, the worst is taken to be so.

    def reads(self) -> Sequence[Request]:
        """The reads without side effects that its device names; empty where there is no device."""
        self._reads = self._asked(DeviceAdapter.reads, self._reads)
        return self._reads

    def hears(self, request: Request) -> bool:
        """Whether its device would act on a broadcast."""
        return self.attached is not None and self._asked(DeviceAdapter.hears, True, request)

    def may_be_moved_by(self, request: Request) -> bool:
        """Whether a write may set its device in motion."""
        return self.attached is not None and self._asked(DeviceAdapter.may_be_moved_by, True, request)

    def disrupts(self, request: Request) -> bool:
        """Whether its device would be away for a while after a write."""
        return self.attached is not None and self._asked(DeviceAdapter.disrupts, True, request)

    def _asked(self, hook: Callable[Concatenate[DeviceAdapter, P], T], instead: T, *args: P.args, **_: P.kwargs) -> T:
        if self.attached is None:
            return instead
        name = hook.__name__
        try:
            said: T = getattr(self.attached, name)(*args)
        except Exception:
            self._note_failure(name)
            return instead
        return said

    def _note_failure(self, hook: str, told: object = "") -> None:
        """Log, once, that a hook of its device has just failed, which was told something."""
        if hook not in self._failing:
            self._failing.add(hook)
            _log.exception("unit %d: its family's own code failed in %s %s", self.address, hook, told)

    def meaning(self, request: Request, code: int | None) -> Meaning:
        """What a refusal says of a request; `code` is None for one inside a normal reply."""
        if code is None:
            return Meaning.REFUSED
        meaning = exception(code).meaning
        if meaning is not Meaning.OPEN:
            return meaning
        known = not request.writes or self._asked(DeviceAdapter.does_nothing, False, request, code)
        return Meaning.REFUSED if known else Meaning.OPEN

    def explain(self, heard: bytes) -> str:
        """What some bytes mean that answer nothing, or that none came; empty where that is nothing special."""
        if self.attached is None:
            return ""
        if heard:
            return self._asked(DeviceAdapter.explain, "", heard)
        return self.attached.when_silent if self.answers.latest is None else ""

    def may_never_answer(self, request: Request) -> bool:
        """Whether it has answered other reads, and this request not: so that its silence proves nothing."""
        if request in self.answers:
            return False
        if self.attached is not None:
            return request not in self.reads()
        return self.answers.latest is not None

    def harmless_read(self) -> Request:
        """What to ask to see whether anybody answers: what is known to be answered; if it is lost, by turns another."""
        if self.probe is False:
            return diagnostic(self.address, Diagnostic.QUERY_DATA, highest=HIGHEST_ADDRESS)
        if self.probe is not None:
            return self.probe
        if self.answers.latest is not None and not self.reach.offline:
            return self.answers.latest
        return self.answers.next_probe(self.address, self.reads())
