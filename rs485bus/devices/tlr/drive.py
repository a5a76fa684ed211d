"""A TL-R drive carrying out moves: how they are said to it. Source: TL-R manual, 3.1, 3.5.3."""

from __future__ import annotations

import math

import anyio

from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.devices.move import Move
from rs485bus.devices.pace import Pace
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.frames import control, words
from rs485bus.devices.tlr.knowledge import TlrKnowledge
from rs485bus.devices.tlr.values import Auxiliary, ControlWord
from rs485bus.devices.travel import Look
from rs485bus.errors import LimitExceeded, RequestFailed
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Repeat

_POLL = 0.01
_START = ControlWord.POSITION | ControlWord.ABSOLUTE


class TlrDrive(TlrKnowledge):
    """One drive, as `TlrStepper` without its settings, tables and homing."""

    start_rpm = 0
    live_jog = False
    ramp_rpm: float | None = None

    # Commands

    async def _write_ahead(self, target: int, pace: Pace) -> None:
        # 0 comes before the target, too: nothing that is still set may start it.
        await self._clear()
        await self._put_target(target, pace)

    async def _send_start(self, target: int, pace: Pace, slot: BurstSlot | None) -> None:
        await self._trigger(_START, pace, slot)
        await self._see_it_start(target)

    def start_frame(self, target: int, pace: Pace) -> Request:
        return control(self.address, _START)

    async def _send_change(self, target: int, pace: Pace, speed: float) -> None:
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

    async def _prepare(self, *, standing: bool = True) -> Look:
        if self._running and not self.live_jog:
            # Whether a jog under way takes another speed is not said.
            await self._stand_still()
        return await super()._prepare(standing=standing)

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

    async def _trigger(self, word: ControlWord, pace: Pace, slot: BurstSlot | None = None) -> None:
        self._drive.ramp_takes = pace.rpm / pace.acceleration
        await self.link.control(word, Repeat.VERIFY, slot)

    async def _see_it_start(self, target: int | None) -> None:
        """The drive took a trigger: see that it moves, or is there already."""
        look = None
        while look is None or look.at < self.attached.may_start_until(self.motion):
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

    # The next target, which also bears witness

    async def _put_target(self, target: int, pace: Pace) -> None:
        start = min(self.start_rpm, pace.speed_code)
        await self._put_positioning(start, pace.ramp_code, pace.ramp_code, pace.speed_code, target)

    async def _put_nothing(self, unlike: int) -> None:
        """A target without a speed: it goes nowhere, and no move is like it, nor what has `unlike` as its time up."""
        if self.keeps_target:
            await self._put_positioning(0, (unlike + 1) % r.MAX_RAMP_MS, 0, 0, 0)

    async def _put_positioning(self, *values: int) -> None:
        data = words(r.POSITIONING.encode(*values))
        self._witness.writing(data)
        await self.link.put(r.POSITIONING, *values)
        if self.keeps_target:
            self._witness.written(data)

    async def _call_witness(self) -> None:
        """See that the drive has not restarted, and have it hold what it would not hold if it had."""
        there = await self.link.read_words(r.POSITIONING)
        if self._witness.denies(there):
            self._restarted("its drive has restarted: what was written to it is gone.")
        if not self._witness.speaks:
            await self._put_nothing(unlike=there[1])

    # What the drive can do

    @property
    def _fastest(self) -> tuple[float, str]:
        return r.MAX_RPM, "what the drive takes"

    def _paced(self, rpm: float, acceleration: float) -> Pace:
        speed = max(1, round(rpm))
        # The time is that of a ramp to the speed, or to one that is always the same.
        full = self.ramp_rpm or float(speed)
        slowest = self.lowest_acceleration(speed)
        if not acceleration >= slowest * 0.999:
            raise LimitExceeded(
                f"{self.name}: acceleration {acceleration:g} rpm/s is below {slowest:g} rpm/s, the slowest at {speed} "
                f"rpm: a ramp takes {r.MAX_RAMP_MS} ms at most"
            )
        time = min(r.MAX_RAMP_MS, round(full * 1000 / acceleration))
        return Pace(float(speed), full * 1000 / time if time else math.inf, speed, time)

    def lowest_acceleration(self, rpm: float) -> float:
        return (self.ramp_rpm or rpm) * 1000 / r.MAX_RAMP_MS

    def _ticks(self, duration: float) -> int:
        if not 0.0005 < duration < math.inf:
            raise LimitExceeded(f"{self.name}: duration {duration:g} s is not 0.001 s or more, with an end")
        return round(duration * 1000)
