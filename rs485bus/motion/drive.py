"""The extension point: what a family says of its drive. Pure, and data where that is possible.

A family says what its drive can be asked and what that tells (`Reading`), what the frames written to it can change
(`Effect`), by which steps it is told what (`Plan`), what it can be told at all (`Ability`), and what the owner of the
wire must know of it (`DeviceAdapter`). It neither waits nor repeats nor decides: that is done here, for all families.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from rs485bus.bus.units.adapter import DeviceAdapter, StandstillDetector
from rs485bus.bus.units.motion import Motion
from rs485bus.errors import BusError, MotionError, NotSupported
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Plan, nothing
from rs485bus.motion.state import MOTION, AxisState, DriveState, Fact, Facts
from rs485bus.motion.stop_judge import StopJudge
from rs485bus.wire.frames import Request, payload

T = TypeVar("T")

_log = logging.getLogger("rs485bus")

_OVERSHOOT = 1.25
"""By how much a motor may be faster for a while than it was told."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Something that a drive can be asked without any effect.

    Args:
        request: the read.
        tells: the facts that it tells.
        decode: what its data bytes tell of each axis. What they say that no manual names is not told.
    """

    request: Request
    tells: frozenset[Fact]
    decode: Callable[[bytes], Sequence[Facts]]


@dataclass(frozen=True, slots=True)
class Effect:
    """What a frame can do to one axis."""

    changes: frozenset[Fact] = frozenset()
    fastest: float | None = None
    """The speed, in rpm, up to which it sets the axis in motion; None if it does not."""
    stops: bool = False
    """It stops the axis."""
    shifts: bool = False
    """The axis is elsewhere afterwards, by its counts: where it stood is no evidence any more."""
    holds: bool | None = None
    """It has the motor hold the shaft, or let go of it; None if it leaves that alone."""
    restarts: str = ""
    """The drive restarts: why positions are not to be trusted then."""
    keeps: bool = False
    """It is a speed that the axis keeps until it is told otherwise."""
    aim: int | None = None
    """To which count it sends the axis; None where it does not, or by a way."""


NO_EFFECT = Effect()
STOPS = Effect(MOTION, stops=True)


class Ability(ABC):
    """What one axis of a drive can be told."""

    counts_per_turn: int

    @property
    @abstractmethod
    def target_range(self) -> tuple[int, int]:
        """The lowest and highest absolute target, in counts."""

    @property
    def reach(self) -> tuple[int, int]:
        """The same for a move by a distance, where the drive can go further so."""
        return self.target_range

    @property
    def longest(self) -> float:
        """The longest distance of one move, in counts."""
        return math.inf

    @property
    @abstractmethod
    def fastest(self) -> tuple[float, str]:
        """The highest speed, in rpm, and what makes it that."""

    @property
    def highest_rpm(self) -> float:
        """The highest speed of moves to a position."""
        return self.fastest[0]

    @property
    def rpm_step(self) -> float:
        """The step in which speeds of moves to a position can be told, in rpm."""
        return 1.0

    @property
    def stream_step(self) -> float:
        """The same for streams, in which what is less is told as standing."""
        return self.rpm_step

    @property
    def ramp_step(self) -> float:
        """The step in which a drive can be told how long a ramp takes, in seconds; 0 where it is told a rate."""
        return 0.0

    @abstractmethod
    def lowest_acceleration(self, rpm: float) -> float:
        """The slowest ramp to a speed, in rpm/s."""

    @abstractmethod
    def parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        """The nearest that the drive can be told to a speed in its range, and to an acceleration.

        Raises:
            LimitExceeded: it cannot accelerate like that.
        """

    def position_parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        """The same for a move to a position."""
        return self.parameters(rpm, acceleration)

    @abstractmethod
    def ticks(self, duration: float) -> int | None:
        """How the duration of a run, in seconds, is said to the drive; None where it does not time runs: the end is
        told when it has come. Raises `LimitExceeded`."""


def said_by_family(name: str, say: Callable[[], T]) -> T:
    """What the family of an axis says of its drive. Raises `MotionError` where its own code fails in that."""
    try:
        return say()
    except BusError:
        raise
    except Exception as error:
        raise MotionError(f"{name}: what its family says of its drive failed: {error!r}") from error


class Drive(DeviceAdapter):
    """One drive of a family.

    Args:
        name: names it in messages.
        address: on its pair.
        axes: what is known of each of its axes.
        motion: the whole of it, where it has several axes.
    """

    telling: tuple[Fact, ...] = (Fact.POSITION,)
    """What shows soonest that something is wrong with a moving axis: asked every interval of supervision."""
    rotation: tuple[Fact, ...] = ()
    """What is asked in turns beside that."""
    causes: tuple[Fact, ...] = (Fact.FAULT, Fact.STALLED, Fact.ENABLED, Fact.LIMIT)
    """What is asked at once when something is wrong, to find out why."""
    knows_counts = True
    """It is known how the drive counts. Else `set_up` finds that out, before positions mean anything."""
    spreads_changes = False
    """Of a stream it spreads a change of the speed over a time, however large the change is."""
    turns_through_zero = False
    """In a stream it may be told a speed the other way while it turns. Else it is slowed down to a stand before."""
    zeroed_by_one_frame = True
    """One frame sets all of its zero. Else its counter may read zero, and the rest be missing."""
    tells_restarts = False
    """What it says afterwards shows every restart: one that was not heard for a while need not be suspected of it. Of
    another one that counts from zero then, what is found at zero after a silence is not trusted."""
    stall_remedy = ""
    """What to do about a stall, in a sentence."""
    fault_remedy = ""
    """What to do about any fault, once its cause is mended, in a sentence."""
    judge: type[StopJudge] = StopJudge
    """Tells whether it stands, by what is asked after a stop."""

    def __init__(self, name: str, address: int, axes: tuple[AxisState, ...], motion: Motion | None = None) -> None:
        self.name = name
        self.address = address
        self.state = DriveState(axes)
        self.motion = motion or axes[0].motion
        self.on_interrupted: Callable[[float, str], None] = lambda unheard, reason: None
        """Called when the bus stopped it for safety, or lost it."""
        self.on_recounted: Callable[[], None] = lambda: None
        """Called when it is found out that it counts otherwise than was known."""
        self._told_by: Sequence[Reading] = ()
        self._told: frozenset[Fact] = frozenset()
        """What can be told by these."""
        self._by_frame = {reading.request.adu: reading for reading in self.readings}

    # Telemetry

    @property
    @abstractmethod
    def readings(self) -> Sequence[Reading]:
        """What it can be asked. Of several that tell a fact the first is preferred."""

    def reading(self, fact: Fact, free: Callable[[Request], bool] = lambda _: True) -> Reading | None:
        """What to ask for a fact, of what is `free` to be asked; None if it tells that in no way now."""
        return next((reading for reading in self.readings if fact in reading.tells and free(reading.request)), None)

    def tells(self, *facts: Fact) -> tuple[Fact, ...]:
        """Those of the facts that this drive tells."""
        readings = self.readings
        if readings is not self._told_by:
            self._told_by, self._told = readings, frozenset().union(*(reading.tells for reading in readings))
        return tuple(fact for fact in facts if fact in self._told)

    def decode(self, request: Request, reply: bytes) -> Sequence[Facts]:
        """What the reply to a request tells of each axis, if it tells anything."""
        reading = self._by_frame.get(request.adu)
        return () if reading is None else reading.decode(payload(reply))

    def effects(self, request: Request) -> Sequence[Effect]:
        """What a write can do to each axis."""
        return ()

    def marks(self, axis: int) -> tuple[Fact, ...]:
        """What a restart would change, by which it is noticed."""
        return self.tells(Fact.POSITION, Fact.ENABLED, Fact.MARK)

    def wanted(self, axis: int) -> tuple[Fact, ...]:
        """What must be known to tell what is wrong with an axis."""
        return self.tells(*dict.fromkeys((Fact.POSITION, Fact.RUNNING, *self.causes, *self.marks(axis))))

    def restarted(self, axis: int) -> str:
        """Why it must have restarted, by these facts; empty if it need not have."""
        return ""

    def halted_by(self, axis: int) -> str:
        """What it says has stopped it, with no fault and nobody here having disabled it, in a sentence; empty if it
        does not say."""
        return ""

    def what_else(self, axis: int) -> str:
        """What may have stopped the axis where the drive reports nothing, in a sentence."""
        return "Another master, or an input, may have stopped it."

    # Plans

    def set_up(self) -> Plan[None]:
        """Read and write what must be known and right before anything else. Asked before each command."""
        return nothing()

    def resume(self, axis: int) -> Plan[None]:
        """Have it ready again after a controlled stop that let go of the motor. Asked before each command."""
        return nothing()

    @abstractmethod
    def enable(self, axis: int) -> Plan[None]:
        """Energise the motor. Raises `NotEnabled`, `DriveFault` where it cannot be."""

    @abstractmethod
    def disable(self, axis: int) -> Plan[None]:
        """Let go of the motor."""

    @abstractmethod
    def zero(self, axis: int) -> Plan[None]:
        """Make the position at which it stands the drive's zero."""

    @abstractmethod
    def move(self, axis: int, target: int, parameters: MotionParameters) -> Plan[None]:
        """Go to a target, in counts. Its last step is the start."""

    @abstractmethod
    def run(self, axis: int, rpm: float, parameters: MotionParameters, ticks: int | None) -> Plan[None]:
        """Change to a speed, in the drive's direction, perhaps for a time. Its last step is the start."""

    def setpoint(self, axis: int, rpm: float, acceleration: float, *, afresh: bool) -> Sequence[Request]:
        """The frames that tell the axis of a stream its next speed, whatever it does.

        What cannot be told exactly is told slower and gentler. 0 is slowing down to a stand.

        Args:
            axis: which one.
            rpm: the speed, in the drive's direction.
            acceleration: of the way there, in rpm/s; infinity for a jump.
            afresh: it is not known whether the drive was told what was told last.
        """
        raise NotSupported(f"{self.name} cannot be told speeds in a stream.")

    def setpoints(self, speeds: Mapping[int, float], acceleration: float, *, afresh: bool) -> Sequence[Request]:
        """The same for several axes at once: the speed of each."""
        if len(speeds) > 1:
            raise NotSupported(f"{self.name} cannot tell its axes their speeds with one frame.")
        return [
            frame for axis, rpm in speeds.items() for frame in self.setpoint(axis, rpm, acceleration, afresh=afresh)
        ]

    def move_all(self, wanted: Mapping[int, tuple[int, MotionParameters]]) -> Plan[None]:
        """Have some axes of the drive go to their targets, started by one frame."""
        raise NotSupported(f"{self.name} cannot start its axes with one frame.")

    def run_all(self, wanted: Mapping[int, tuple[float, MotionParameters]]) -> Plan[None]:
        """Have some axes of the drive change to speeds, told by one frame."""
        raise NotSupported(f"{self.name} cannot tell its axes their speeds with one frame.")

    def retarget(self, axis: int, target: int, parameters: MotionParameters, speed: float) -> Plan[None]:
        """Send a move under way, which has this speed in rpm, elsewhere. Its last step is the start."""
        raise NotSupported(f"{self.name} cannot be sent elsewhere while it moves: stop() it first.")

    @abstractmethod
    def start_frame(self, axis: int, target: int, parameters: MotionParameters) -> Request:
        """The frame by which such a move starts."""

    @abstractmethod
    def ability(self, axis: int) -> Ability:
        """What the axis can be told."""

    # As the owner of the wire sees it

    @abstractmethod
    def slows_down_for(self, emergency: bool) -> float:
        """Seconds that may pass between a stop frame and standing."""

    def stopped_with(self, axis: int, emergency: bool) -> Motion:
        """What a stop of an axis stops: that axis, or all of the drive."""
        return self.state.axes[axis].motion

    def known_stops(self, motion: Motion) -> Sequence[Request]:
        axes = (axis for axis in self.state.axes if motion in (axis.motion, self.motion))
        return tuple(dict.fromkeys(axis.ramp_stop for axis in axes if axis.ramp_stop is not None))

    def stopping_time(self, emergency: bool) -> float:
        # It takes a while to see it stand, too.
        slows_down_for = self.slows_down_for(emergency and not self.goes_by_known_stops)
        return slows_down_for + max(axis.rule.apart for axis in self.state.axes)

    def judgement(self, motion: Motion) -> StandstillDetector:
        axes = [at for at, axis in enumerate(self.state.axes) if axis.motion is motion]
        return self.judge(self, axes or range(len(self.state.axes)))

    def on_reply(self, request: Request, reply: bytes, asked_at: float, now: float) -> None:
        self.state.misunderstood = None
        try:
            told = () if request.writes else self.decode(request, reply)
            self.state.hear(asked_at, now, told, tells_restarts=self.tells_restarts)
        except Exception as error:
            self.state.misunderstood = error
            self.state.silence.missed(asked_at)  # it tells no more than silence does
            raise

    def on_unanswered(self, sent_at: float) -> None:
        self.state.silence.missed(sent_at)

    def on_busy(self) -> None:
        self.state.was_busy = True

    def on_late_reply(self, sent_at: float) -> None:
        self.state.hear_late(sent_at)

    def on_sent(self, request: Request, at: float) -> None:
        if not request.writes:
            return
        try:
            for number, effect in enumerate(self.effects(request)):
                self._take_effect(number, effect, at)
        except Exception:
            for axis in self.state.axes:  # it may have done anything
                axis.change(Fact, at)
                axis.start(math.inf, at)
            raise
        finally:
            self.state.tell()

    def interrupted(self, unheard: float, reason: str) -> None:
        self.on_interrupted(unheard, reason)

    def _take_effect(self, number: int, effect: Effect, at: float) -> None:
        axis = self.state.axes[number]
        axis.change(effect.changes, at)
        if effect.fastest is not None:
            axis.start(_OVERSHOOT * effect.fastest / 60 * self.ability(number).counts_per_turn, at, effect.aim)
        if Fact.RUNNING in effect.changes or effect.holds is False:
            axis.keeps = effect.keeps
        if effect.stops:
            axis.stopped_at = at
        if effect.shifts:
            axis.stood_at = None
        if effect.holds is not None:
            axis.holds = effect.holds
        if effect.restarts:
            axis.stood_at = axis.holds = None
            axis.lost = effect.restarts
