"""A TL-R drive carrying out moves: what the shared axis leaves to the family. Source: TL-R manual, 3.1, 3.5.3."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TypeVar

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.job import Urgency
from rs485bus.devices.conduct import Look, Pace
from rs485bus.devices.move import Move
from rs485bus.devices.retarget import Retargeting
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.alarms import alarm_of
from rs485bus.devices.tlr.attached import FAMILY, TlrAttached
from rs485bus.devices.tlr.frames import words
from rs485bus.devices.tlr.link import Link
from rs485bus.devices.tlr.telemetry import Report
from rs485bus.devices.tlr.values import Auxiliary, ControlWord, DiFunction, StatusWord
from rs485bus.devices.tlr.witness import Witness
from rs485bus.errors import (
    DriveFault,
    LimitExceeded,
    MotionError,
    MoveFailed,
    ReferenceLost,
    RequestFailed,
)
from rs485bus.wire.registers import Repeat

T = TypeVar("T")

_POLL = 0.01
_START = ControlWord.POSITION | ControlWord.ABSOLUTE
_MOVING_INPUTS = {function.value for function in DiFunction if function.moves}
_TOLERANCE = 500
"""What part of a turn positions may differ by, where nothing else was said: eight steps of the encoder."""


@dataclass(frozen=True, slots=True)
class TlrLook(Look):
    """What a drive said of its axis, and of itself."""

    report: Report
    restarted: bool
    """What was written to it is gone."""


class TlrDrive(Retargeting):
    """One drive, as `TlrStepper` without its settings, tables and homing."""

    def __init__(
        self,
        bus: Bus,
        address: int,
        *,
        pulses_per_turn: int | None,
        units_per_turn: float,
        reverse: bool,
        limits: tuple[float, float] | None,
        rpm: float,
        acceleration: float,
        start_rpm: int,
        tolerance: int | None,
        clear_trigger: bool,
        block_writes: bool,
        keeps_target: bool,
        enabled_bit: bool,
        live_jog: bool,
        ramp_rpm: float | None,
    ) -> None:
        if pulses_per_turn is not None and pulses_per_turn < 1:
            raise ValueError(f"pulses_per_turn {pulses_per_turn} is below 1")
        if ramp_rpm is not None and not ramp_rpm > 0:
            raise ValueError(f"ramp_rpm {ramp_rpm} is not above 0")
        self.address = address
        self.start_rpm = r.START_SPEED.raw(start_rpm)
        self.ramp_rpm = ramp_rpm
        self.keeps_target = keeps_target
        self.enabled_bit = enabled_bit
        self.live_jog = live_jog
        # Nothing is refused at the coarsest subdivision that could be gone to at the one it turns out to have.
        self.counts_per_turn = pulses_per_turn or r.LEAST_PULSES
        self._pulses = pulses_per_turn
        self._given_tolerance = tolerance
        self._drive = TlrAttached(address, self.told_standing, self._was_interrupted)
        self.link = Link(bus, self._drive, clear_trigger=clear_trigger, block_writes=block_writes)
        self._ready = False
        self._energised: bool | None = None
        """Whether it was told to hold its motor; None if it was told nothing since it started."""
        self._driven = False
        """An input may set the motor in motion."""
        self._witness = Witness()
        super().__init__(
            bus,
            self._drive,
            self._drive.motion,
            f"{FAMILY} {address}",
            units_per_turn=units_per_turn,
            reverse=reverse,
            limits=limits,
            rpm=rpm,
            acceleration=acceleration,
            tolerance=tolerance or 2,
        )
        bus.attach(self)

    @property
    def target_range(self) -> tuple[int, int]:
        return r.TARGET.number.low, r.TARGET.number.high

    def setting(self, what: str, carry_out: Callable[[], Awaitable[T]]) -> Handle[T]:
        """Queue a command that is no move, once the drive is set up. For what the facade is made of."""

        async def set_up_first() -> T:
            await self._set_up()
            return await carry_out()

        return self._order(what, set_up_first)

    # Questions

    async def _set_up(self) -> None:
        if self._ready:
            return
        pulses = self._pulses
        if pulses is None:
            pulses = await self.link.read(r.SUBDIVISION)
        if pulses != self.counts_per_turn:
            self._forget()
        self.counts_per_turn = pulses
        self.tolerance = self._given_tolerance or max(2, pulses // _TOLERANCE)
        functions = await self.link.read_words(r.ALL_INPUT_FUNCTIONS)
        self._driven = not _MOVING_INPUTS.isdisjoint(functions)
        self._ready = True

    async def report(self, urgency: Urgency = Urgency.COMMAND) -> Report:
        """All that the drive reports, of one moment."""
        return Report(*await self.link.read_block(r.TELEMETRY, urgency))

    async def _look(self, *, quick: bool = False) -> TlrLook:
        at = self.bus.now()
        report = await self.report(Urgency.POLL)
        assert report.position is not None
        restarted = False
        if self._witness.speaks and not (quick and report.moving):
            restarted = self._witness.denies(await self.link.read_words(r.POSITIONING, Urgency.POLL))
        if restarted:
            self._restarted()
            if quick:
                raise self._reference_lost()
        enabled = StatusWord.ENABLED in report.status if self.enabled_bit else self._energised is True
        return TlrLook(at, report.position, report.moving, enabled, report, restarted)

    async def _read_position(self) -> int:
        await self._set_up()
        position = (await self.report()).position
        assert position is not None
        return position

    async def _read_velocity(self) -> float:
        rpm = await self.link.read(r.SPEED)
        return float(rpm)

    def _restarted(self) -> None:
        """It counts from zero again, and is as it was saved."""
        self._lost = "its drive has restarted: what was written to it is gone."
        self._witness.forget()
        self._energised = self._enabled = None
        self._ready = False
        self._forget()

    def _reference_lost(self) -> ReferenceLost:
        return ReferenceLost(f"{self.name}: {self._lost} enable() it, then home() it or set_zero().")

    def _check_reference(self, look: Look, seen: Look | None) -> None:
        if isinstance(look, TlrLook) and look.restarted:
            raise self._reference_lost()
        if seen is not None and self._driven and self._witness.speaks and not self._near(look.position, seen.position):
            # An input has moved it; it has counted on.
            self._forget()
            seen = None
        super()._check_reference(look, seen)

    async def _prepare(self, *, standing: bool = True) -> Look:
        if self._running and not self.live_jog:
            await self._stand_still()
        look = await super()._prepare(standing=standing)
        if look.moving and not self._running:
            # An input turns it.
            await self._stand_still()
            look = await super()._prepare(standing=standing)
        if isinstance(look, TlrLook):
            self._check_fault(look.report)
        return look

    def _check_fault(self, report: Report) -> None:
        """Raise `DriveFault` where the drive reports one: it would not move."""
        if StatusWord.FAULT in report.status or report.alarm:
            raise DriveFault(f"{self.name} reports {alarm_of(report.alarm or 0) or 'a fault without an alarm'}.")

    async def _why(self, look: Look, target: int) -> MotionError:
        if not isinstance(look, TlrLook) or look.restarted:
            return self._reference_lost()
        try:
            self._check_fault(look.report)
        except DriveFault as fault:
            # Whether the motor was held all the time is not known.
            self._lost = "its drive raised an alarm in the middle of a move."
            return fault
        place = f"{self.name} stands {abs(target - look.position)} pulses short of where it was sent"
        for limit in (StatusWord.POSITIVE_SOFT_LIMIT, StatusWord.NEGATIVE_SOFT_LIMIT):
            if limit in look.report.status:
                return MoveFailed(f"{place}, at its {str(limit.name).lower().replace('_', ' ')}: set_soft_limits().")
        if not self._witness.speaks:
            self._lost = "it stood still before it had reached its target."
        return MoveFailed(
            f"{place}, with inputs {look.report.inputs!r}. A limit switch or another input may hold it; if it does not "
            "move at all, it may need clear_trigger=True."
        )

    # Commands

    async def _send_move(self, target: int, pace: Pace) -> None:
        # 0 comes before the target, too: nothing that is still set may start it.
        await self._clear()
        await self._put_target(target, pace)
        await self._trigger(_START, pace)
        await self._see_it_start(target)

    async def _send_change(self, target: int, pace: Pace) -> None:
        await self._put_target(target, pace)
        if self.link.clear_trigger:
            await self.link.control(ControlWord.ABSOLUTE | ControlWord.INTERRUPT)
        await self._trigger(_START | ControlWord.INTERRUPT, pace)

    async def _send_run(self, rpm: float, pace: Pace, ticks: int | None) -> None:
        if rpm == 0:
            await self._stand_still()
            return
        running = self._running
        if not running:
            await self._clear()
        await self.link.put(r.JOG, round(rpm), pace.ramp_code, pace.ramp_code)
        if not running:
            await self._trigger(ControlWord.JOG, pace)
            await self._see_it_start(None)

    async def _run(self, move: Move, rpm: float, pace: Pace, duration: float | None, ticks: int | None) -> float:
        """As every axis; but a run for a time is a positioning over what it covers.

        The drive knows no time, and does not notice when nobody is there to stop it.
        """
        if duration is None or rpm == 0:
            return await super()._run(move, rpm, pace, duration, ticks)
        ramp = pace.rpm / pace.acceleration
        turns = rpm * duration * min(1.0, duration / ramp if ramp else 1.0) / 60

        def target(look: Look) -> int:
            move.target = self._to_units(look.position + round(turns * self.counts_per_turn))
            return self._target(move.target)

        return self._to_units((await self._carry_out(move, target, pace)).position)

    async def _send_enable(self, on: bool) -> None:
        if on:
            # What stopped it may hold it as long as its bit is set.
            await self.link.control(ControlWord.NONE)
            await self._call_witness()
        await self.link.auxiliary(Auxiliary.ENABLE if on else Auxiliary.RELEASE)
        self._energised = on

    async def _send_zero(self) -> None:
        # Clearing the position of a standing motor twice is clearing it once.
        await self.link.auxiliary(Auxiliary.CLEAR_POSITION)

    async def _clear(self) -> None:
        if self.link.clear_trigger:
            await self.link.control(ControlWord.NONE)

    async def _trigger(self, word: ControlWord, pace: Pace) -> None:
        self._drive.ramp_takes = pace.rpm / pace.acceleration
        await self.link.control(word, Repeat.VERIFY)

    async def _put_target(self, target: int, pace: Pace) -> None:
        start = min(self.start_rpm, pace.speed_code)
        await self._put_positioning(start, pace.ramp_code, pace.ramp_code, pace.speed_code, target)

    async def _put_positioning(self, *values: int) -> None:
        data = words(r.POSITIONING.encode(*values))
        self._witness.writing(data)
        await self.link.put(r.POSITIONING, *values)
        if self.keeps_target:
            self._witness.written(data)

    async def _call_witness(self) -> None:
        """See that the drive has not restarted, and have it hold what no saved target is."""
        if not self.keeps_target:
            return
        there = await self.link.read_words(r.POSITIONING)
        if self._witness.denies(there):
            self._restarted()
        if not self._witness.speaks:
            await self._put_nothing(there[1])

    async def _put_nothing(self, up: int) -> None:
        """A target without a speed: nothing goes there, and no move is like it. `up` is the time it must not have."""
        await self._put_positioning(0, (up + 1) % r.MAX_RAMP_MS, 0, 0, 0)

    async def _see_it_start(self, target: int | None) -> None:
        """The drive took a trigger: see that it moves, or is there already."""
        look = None
        while look is None or look.at < self.motion.commanded_at + self._drive.start_grace:
            try:
                look = await self._look(quick=True)
            except RequestFailed:
                return  # whoever waits for its end finds out
            if look.moving or (target is not None and self._near(look.position, target)):
                return
            await anyio.sleep(_POLL)
        # It must not start after all once this has been said.
        await self._stand_still()
        raise await self._why(look, look.position if target is None else target)

    # What the drive can do

    def _pace(self, rpm: float | None, acceleration: float | None) -> Pace:
        wanted = self.rpm if rpm is None else rpm
        if not 0 < wanted <= r.MAX_RPM:
            raise LimitExceeded(f"{self.name}: {wanted:g} rpm is outside 0..{r.MAX_RPM} rpm")
        speed = max(1, round(wanted))
        wanted = self.acceleration if acceleration is None else acceleration
        # The time is that of a ramp to the speed, or to one that is always the same.
        full = self.ramp_rpm or float(speed)
        slowest = full * 1000 / r.MAX_RAMP_MS
        if not wanted >= slowest * 0.999:
            raise LimitExceeded(
                f"{self.name}: acceleration {wanted:g} rpm/s is below {slowest:g} rpm/s, the slowest at {speed} rpm: a "
                f"ramp takes {r.MAX_RAMP_MS} ms at most"
            )
        time = min(r.MAX_RAMP_MS, round(full * 1000 / wanted))
        return Pace(float(speed), full * 1000 / time if time else math.inf, speed, time)

    def _ticks(self, duration: float) -> int:
        ticks = round(duration * 1000)
        if ticks < 1:
            raise LimitExceeded(f"{self.name}: duration {duration:g} s is below 0.001 s")
        return ticks

    # What the bus says

    def _was_interrupted(self, unheard: float, reason: str) -> None:
        self._ready = False
        super()._was_interrupted(unheard, reason)
