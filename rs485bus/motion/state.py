"""What is known of a drive and its axes. Every reply feeds it, whoever asked. Pure.

Each fact carries the earliest time at which its reply can have been asked for. An older one never replaces a newer one.
A frame that can change a fact invalidates it when it is sent, whoever sends it.
"""

from __future__ import annotations

import enum
import functools
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from rs485bus.bus.units.motion import Motion
from rs485bus.motion.silence import Silence
from rs485bus.motion.standstill import NEVER, Standstill, StandstillRule
from rs485bus.wire.frames import Request

_log = logging.getLogger("rs485bus")

_FOREVER = float("inf")
_STAYS = 0.2
"""The part of a jump by which a position may differ that is none."""
FRESH = 0.25
"""Seconds after which a drive that was not heard may have restarted, and a standing axis is looked at again."""


class Fact(enum.Enum):
    """What a reply may tell of an axis."""

    POSITION = "position"
    """Counts."""
    RUNNING = "running"
    """Whether its status says that it moves; None where the status says nothing."""
    SPEED = "speed"
    """rpm, in the direction in which the position grows."""
    ENABLED = "enabled"
    FAULT = "fault"
    """What the drive reports, in words; empty if there is none."""
    STALLED = "stalled"
    PUSHES = "pushes"
    """Whether it says that it drives the motor to a speed or at it: where it stands then, something holds the shaft."""
    LIMIT = "limit"
    """The limit that is reached, in words; empty if there is none."""
    HOMED = "homed"
    """How its homing stands, in the family's terms."""
    INPUTS = "inputs"
    """The levels of its inputs, in the family's terms."""
    MARK = "mark"
    """What a restart of the drive would change, in the family's terms."""

    __hash__ = object.__hash__


_POSITION, _RUNNING, _SPEED, _PUSHES = Fact.POSITION, Fact.RUNNING, Fact.SPEED, Fact.PUSHES
MOTION = frozenset({_POSITION, _RUNNING, _SPEED, _PUSHES})
"""What a frame that starts or stops an axis changes."""
Facts = Mapping[Fact, Any]


class Known(NamedTuple):
    """A fact."""

    value: Any
    at: float
    """The earliest time at which its reply can have been asked for."""


_UNKNOWN = Known(None, NEVER)
_known = functools.partial(tuple.__new__, Known)
"""As `Known`, of a tuple, in half the time: every reply makes some."""


class AxisState:
    """What is known of one axis.

    Args:
        motion: the axis, as the owner of the wire knows it.
        rule: how it is seen to stand.
        jump: counts by which a standing axis may shift, as a loaded shaft does. One that shifts further has restarted.
    """

    def __init__(self, motion: Motion, rule: StandstillRule, jump: int) -> None:
        self.motion = motion
        self.rule = rule
        self.jump = jump
        self.standstill = Standstill(rule)
        self.unit = "counts"
        """What its counts are called in messages."""
        self.may_be_moved = False
        """Something else than the bus may move it, while its drive counts on."""
        self.stood_at: int | None = None
        """The position at which it was last seen standing, unless something may have moved it since."""
        self.holds: bool | None = None
        """Whether its motor was told to hold the shaft; None if it was told nothing since it started."""
        self.lost = ""
        """Why its positions are not to be trusted."""
        self.distrusted = ""
        """That, where it was last for another reason than a restart."""
        self.fastest = 0.0
        """How fast it can have moved since it last stood, in counts a second."""
        self.aims: tuple[int, int] | None = (0, 0)
        """Between which counts zero lies, and all that it was told to go to since it last stood; None where it may have
        been told to go anywhere."""
        self.between: tuple[int, int | None] | None = None
        """From where to where it went, in counts, when nobody knows what became of that: where it is seen next shows
        whether its drive has restarted. The end is None where it may have gone anywhere."""
        self.silent_since = NEVER
        """When its drive gave the last answer before a silence in which it may have restarted."""
        self.back_at: float | None = None
        """When it was asked what it answered first after that; None where its position was told since."""
        self.back_heard_at = NEVER
        """When that answer came."""
        self.was_unheard = False
        """Its drive was not heard for so long, before its last answer, that it may have restarted."""
        self.ran_at = NEVER
        """When it was last asked, and said that it moves, and not that it slows down."""
        self.keeps = False
        """It was told a speed that it keeps until it is told otherwise, whoever told it."""
        self.counts_anew = False
        """Its drive looks for its reference, and counts from there: no position shows that it has restarted."""
        self.stopped_at = NEVER
        """When a frame was last sent that stops it, whoever sent it."""
        self.told_at = NEVER
        """When the first frame was sent of those by which it was last set in motion: it may have heard any of them."""
        self.ramp_stop: Request | None = None
        """What stops by its ramp what it was told last; None where there is nothing like that."""
        self.ramp_takes = 0.0
        """Seconds that this takes."""
        self.last_way = (NEVER, NEVER, 0)
        """When its position was asked for the time before last, when the last time, and the counts in between."""
        self.news = 0
        """How often anything was told that is not what was told before."""
        self._facts: dict[Fact, Known] = {}
        self._changed: dict[Fact, float] = {}

    def last(self, fact: Fact) -> Known:
        """A fact as it was last told, though it may have changed since; the value None if it was never told."""
        return self._facts.get(fact, _UNKNOWN)

    def known(self, fact: Fact) -> Known:
        """A fact, if it was asked for after the last frame that can have changed it; else the value None."""
        known = self._facts.get(fact, _UNKNOWN)
        return known if known.at >= self._changed.get(fact, NEVER) else _UNKNOWN

    def value(self, fact: Fact) -> Any:
        """The value of `known`."""
        return self.known(fact).value

    def changed_at(self, fact: Fact) -> float:
        """When the last frame was sent that can have changed a fact."""
        return self._changed.get(fact, NEVER)

    def since(self, at: float, facts: Iterable[Fact]) -> bool:
        """Whether all these facts were asked for at a time or later."""
        return all(self.known(fact).at >= at for fact in facts)

    @property
    def stands(self) -> bool | None:
        """Whether it stands, by what was asked since the last frame that starts or stops it; None: unknown."""
        return self.standstill.verdict

    # What changes it

    def set_rule(self, rule: StandstillRule) -> None:
        """It is seen to stand in another way from now on."""
        self.rule = self.standstill.rule = rule

    def learn(self, facts: Facts, at: float, now: float, by: float = NEVER) -> None:
        """A reply told these facts. It came now, and was asked for at a time or later; they were so `by` then at the
        latest."""
        for fact, value in facts.items():
            before = self._facts.get(fact, _UNKNOWN)
            if at >= before.at and at >= self._changed.get(fact, NEVER):
                if fact is _POSITION:
                    self._notice_jump(before, value, at, now)
                    if before.value is not None:
                        self.last_way = (before.at, at, self.rule.moved(before.value, value))
                elif fact is _RUNNING and value and facts.get(_PUSHES, True):
                    self.ran_at = at
                if value != before.value:
                    self.news += 1
                self._facts[fact] = _known((value, at))
        if at >= self.standstill.until and at >= self._changed.get(_POSITION, NEVER):
            told = facts.get
            self.standstill.see(at, told(_POSITION), told(_RUNNING), told(_SPEED), by)

    def change(self, facts: Iterable[Fact], at: float) -> None:
        """A frame that can change these facts goes out."""
        for fact in facts:
            self._changed[fact] = at
            if fact is _POSITION:
                self.standstill.forget()

    def start(self, fastest: float, at: float = NEVER, aim: int | None = None) -> None:
        """It may move from now on, at up to so many counts a second; to that count, where it was told one."""
        aims = self.aims if self.fastest else (0, 0)
        self.aims = (min(aims[0], aim), max(aims[1], aim)) if aims is not None and aim is not None else None
        self.stood_at = None
        self.told_at = at if self.told_at == NEVER else self.told_at
        self.fastest = max(self.fastest, fastest)

    def stood(self) -> None:
        """It stands, as was last asked."""
        self.stood_at = self.value(Fact.POSITION)
        self.fastest = 0.0
        self.motion.stands(self.standstill.until)

    def suspect(self, why: str) -> None:
        """Its drive may have restarted: its positions are not to be trusted."""
        self.lost = self.lost or why

    def distrust(self, why: str) -> None:
        """Its positions are not to be trusted, for another reason."""
        if not self.lost:
            self.lost = self.distrusted = why

    @property
    def obeyed_at(self) -> float:
        """When it was last known to do what it was told."""
        return max(self.ran_at, self.motion.commanded_at)

    @property
    def may_count_anew(self) -> bool:
        """Whether it is where it can have come to if its drive has restarted since it was last known to obey."""
        position = self.known(Fact.POSITION)
        moved_until = self.standstill.since if self.stands else position.at
        reach = self.jump + self.fastest * max(0.0, moved_until - self.obeyed_at)
        return position.value is not None and abs(position.value) <= reach < _FOREVER

    def _notice_jump(self, before: Known, position: int, at: float, now: float) -> None:
        """Notice a position to which it cannot have come: its drive counts anew."""
        if self.may_be_moved:
            self.stood_at = None
        between, self.between = self.between, None
        back_at = self.back_at if at >= self.back_heard_at else None  # else that may have been asked before
        self.back_at = self.back_at if back_at is None else None
        unheard, self.was_unheard = self.was_unheard, False
        if self.counts_anew:
            return
        if between is not None and not self._is_plausible(position, *between):
            self.suspect("it is not where it could have gone while it was not heard: the drive may have restarted.")
        elif self.stood_at is not None and self.holds:
            way = self.rule.moved(self.stood_at, position)
            if abs(way) > self.jump:
                self.stood_at = None
                self.suspect(
                    f"it stands {way} {self.unit} from where it stood, and nobody moved it: the drive may have "
                    "restarted."
                )
        elif before.value is not None and self.fastest and self.motion.may_move:
            way = self.rule.moved(before.value, position)
            if abs(way) > self.jump + self.fastest * (now - before.at):
                self.suspect(
                    f"it is {way} {self.unit} from where it was, sooner than it can have gone there: the drive may "
                    "have restarted."
                )
        if before.value is None:
            return
        if back_at is not None and self._may_count_anew(before, position, now - back_at):
            self.suspect(
                f"its drive did not answer for a while, and then it was {position} {self.unit} from zero: the "
                "drive may have restarted."
            )
        elif unheard and self._is_just_at_zero(before, position):
            self.suspect(
                f"it was {before.value} {self.unit} from zero when it was heard last, and stands at zero now: "
                "the drive may have restarted."
            )

    def _is_just_at_zero(self, before: Known, position: int) -> bool:
        """Whether it stands exactly where a drive begins to count, and stood elsewhere, whether it was held or not."""
        moved = self.motion.may_move or before.at < self._changed.get(Fact.POSITION, NEVER)
        return not moved and abs(before.value) > self.jump and abs(position) <= self.rule.same

    def _may_count_anew(self, before: Known, position: int, for_seconds: float) -> bool:
        """Whether a drive that may have restarted, and answers again for so many seconds, can have counted to this
        position since; and that would matter."""
        told = self.motion.commanded_at > self.silent_since and self.fastest < _FOREVER
        reach = self.jump + (self.fastest * for_seconds if told else 0.0)
        way = abs(self.rule.moved(before.value, position))
        if not (self.motion.may_move or self.motion.commanded_at > before.at):
            stayed = way <= self.jump * _STAYS
        elif told and self.aims is not None:
            # It is not on its way from zero; or where it was before, which is none of its aims.
            first, last = self.aims
            stayed = not first - self.jump <= position <= last + self.jump
            stayed |= way <= self.rule.same and min(abs(position - first), abs(position - last)) > self.jump
        else:
            stayed = False
        return abs(position) <= reach and not stayed

    def _is_plausible(self, position: int, start: int, end: int | None) -> bool:
        """Whether a motion from one place to another may have ended here; at zero, where a drive begins to count after
        a restart, only if it began or ended there."""
        if abs(position) <= self.jump:
            return abs(start) <= self.jump or (end is not None and abs(end) <= self.jump)
        return end is None or min(start, end) - self.jump <= position <= max(start, end) + self.jump


class DriveState:
    """What is known of one drive.

    Args:
        axes: its axes.
    """

    def __init__(self, axes: tuple[AxisState, ...]) -> None:
        self.axes = axes
        self.heard_at = NEVER
        """When it was last asked something that it answered."""
        self.gap_at = NEVER
        """When it was first heard after its last silence, in which it may have restarted."""
        self.silent_until = NEVER
        """The same of the last one in which it was asked, too, and did not answer, or was busy."""
        self.was_busy = False
        """It has said so since its last reply."""
        self._answered_at = NEVER
        """When its last reply came."""
        self.so_by = NEVER
        """The latest time at which what its last reply tells can have been so. One that was asked for once is as old as
        the quickest one was; where a first attempt was lost, that says nothing."""
        self._quickest = 0.0
        """The fewest seconds in which it has answered anything."""
        self.silence = Silence()
        self.misunderstood: Exception | None = None
        """Why its last reply could not be understood."""
        self._unheeded: Exception | None = None
        self._has_failed = False
        """That was logged."""
        self._told: Sequence[Facts] = ()
        """What its last reply told."""
        self._listeners: list[Callable[[], None]] = []

    def listen(self, listener: Callable[[], None]) -> None:
        """Call back after every reply, and after every frame that changes something."""
        self._listeners.append(listener)

    def hear(self, at: float, now: float, told: Sequence[Facts], *, tells_restarts: bool = True) -> None:
        """A reply told these facts, of each axis. It came now, and was asked for at a time or later.

        Where the drive does not tell its restarts, and was silent for a while, where it is next is held against that.
        """
        if at > self.heard_at + FRESH:
            self.gap_at = at
            for axis in self.axes:
                axis.was_unheard = not tells_restarts
        was_asked, was_silent = self.silence.has_missed or self.was_busy, self.silence.answered(now)
        self.was_busy = False
        if now > self._answered_at + FRESH:
            if at <= self.heard_at + FRESH:
                self.gap_at = now  # the first attempt may have been made long ago, and be what is answered
            if was_silent and not tells_restarts:
                for axis in self.axes:
                    axis.silent_since, axis.back_at, axis.back_heard_at = self._answered_at, at, now
        if was_asked:
            self.silent_until = self.gap_at
        took, quickest = now - at, self._quickest
        self._answered_at, self.so_by = now, at if took < quickest else now - quickest
        if took < quickest or not quickest:
            self._quickest = took
        if at > self.heard_at:
            self.heard_at = at
        self._told = told
        for axis, facts in zip(self.axes, told, strict=False):
            if facts:
                axis.learn(facts, at, now, self.so_by)
        self.tell()

    def was_told(self, fact: Fact, now: float) -> bool | None:
        """Whether the reply that came now told a fact of any axis; None if none did that is known to be new."""
        return any(fact in facts for facts in self._told) if self._answered_at == now else None

    def hear_late(self, sent_at: float) -> None:
        """A late reply came, to what was sent then at the latest: it shows for how long the drive has gone on."""
        if not self.silence.came_late(sent_at):
            for axis in self.axes:
                axis.back_at = None

    def unsure_since(self, now: float) -> float:
        """When, or later, what a restart would change must have been asked."""
        return now if now > self.heard_at + FRESH else self.gap_at

    def tell(self) -> None:
        """Something has changed."""
        for listener in self._listeners:
            try:
                listener()
            except Exception as error:
                if not self._has_failed:
                    _log.exception("who was to be told of a drive failed")
                self._unheeded, self._has_failed = error, True

    def take_unheeded(self) -> Exception | None:
        """Why somebody has failed who was told of it since this was last asked: he may have missed what matters."""
        unheeded, self._unheeded = self._unheeded, None
        return unheeded
