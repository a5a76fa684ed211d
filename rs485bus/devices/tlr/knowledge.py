"""What is known of a TL-R drive: where it is, whether it is held, whether it has restarted, why it stands.

Source: TL-R manual, 3.5.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from rs485bus.arguments import flag, whole
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.retarget import Retargeting
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.adapter import FAMILY, TlrAttached
from rs485bus.devices.tlr.alarms import alarm_of
from rs485bus.devices.tlr.link import Link
from rs485bus.devices.tlr.telemetry import Report
from rs485bus.devices.tlr.values import DiFunction, StatusWord
from rs485bus.devices.tlr.witness import Witness
from rs485bus.devices.travel import Look
from rs485bus.errors import DriveFault, MotionError, MoveFailed, ReferenceLost
from rs485bus.wire.frames import unit_address
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")

_MOVING_INPUTS = {function.value for function in DiFunction if function.moves}
_TOLERANCE = 500
"""What part of a turn positions may differ by, where nothing else was said: eight steps of the encoder."""


@dataclass(frozen=True, slots=True)
class TlrLook(Look):
    """What a drive said of its axis, and of itself."""

    report: Report
    restarted: bool
    """What was written to it is gone."""


class TlrKnowledge(Retargeting):
    """One drive, as it is asked. Arguments as for `TlrStepper`."""

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
        tolerance: int | None,
        clear_trigger: bool,
        block_writes: bool,
        keeps_target: bool,
        enabled_bit: bool,
    ) -> None:
        if pulses_per_turn is not None:
            pulses_per_turn = whole("pulses_per_turn", pulses_per_turn, 1)
        self.address = unit_address(address)
        self.keeps_target = self.tells_restarts = flag("keeps_target", keeps_target)
        self.enabled_bit = flag("enabled_bit", enabled_bit)
        # Nothing is refused at the coarsest subdivision that could be gone to at the one it turns out to have.
        self.counts_per_turn = pulses_per_turn or r.LEAST_PULSES
        self._pulses = pulses_per_turn
        self._given_tolerance = tolerance
        self._drive = TlrAttached(self.address, self.told_standing, self._was_interrupted)
        self.link = Link(
            bus,
            self._drive,
            clear_trigger=flag("clear_trigger", clear_trigger),
            block_writes=flag("block_writes", block_writes),
        )
        self._ready = False
        self._energised: bool | None = None
        """Whether it was told to hold its motor; None if it was told nothing since it started."""
        self._driven = False
        """An input may set the motor in motion."""
        self._witness = Witness()
        self._gone = False
        """It has restarted since the command under way began."""
        super().__init__(
            bus,
            self._drive,
            self._drive.motion,
            f"{FAMILY} {self.address}",
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

    # For the parts of the facade

    async def set_up(self) -> None:
        """Know what must be known before anything else."""
        await self._set_up()

    def setting(self, what: str, carry_out: Callable[[], Awaitable[T]]) -> Handle[T]:
        """Queue a command that is no move, for when the drive is set up."""

        async def set_up_first() -> T:
            await self._set_up()
            return await carry_out()

        return self._order(what, set_up_first)

    def put_setting(self, where: Register[Any] | Block, *values: Any, again: bool = False) -> Handle[None]:
        """Queue the writing of a setting, and its reading back. `again`: what was known at set-up changes by it."""
        where.encode(*values)

        async def carry_out() -> None:
            self._ready = self._ready and not again
            await self.link.put(where, *values)

        return self.setting(f"{where.name} = {', '.join(map(str, values))}", carry_out)

    # Questions

    async def report(self, urgency: Urgency = Urgency.COMMAND) -> Report:
        """All that the drive reports, of one moment."""
        return Report(*await self.link.read_block(r.TELEMETRY, urgency))

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

    async def _look(self, *, quick: bool = False) -> TlrLook:
        at = self.bus.now()
        report = await self.report(Urgency.POLL)
        assert report.position is not None
        restarted = False
        if self._witness.speaks and not (quick and report.moving):
            restarted = self._witness.denies(await self.link.read_words(r.POSITIONING, Urgency.POLL))
        if restarted:
            self._restarted("its drive has restarted: what was written to it is gone.")
        if quick and self._gone:
            raise self._reference_lost()
        enabled = StatusWord.ENABLED in report.status if self.enabled_bit else self._energised is True
        return TlrLook(at, report.position, report.moving, enabled, report, restarted)

    async def _turns(self) -> bool:
        return (await self.report()).moving

    async def _read_position(self) -> int:
        await self._set_up()
        position = (await self.report(Urgency.POLL)).position
        assert position is not None
        return position

    async def _read_velocity(self) -> float:
        rpm = await self.link.read(r.SPEED, Urgency.POLL)
        return float(rpm)

    # What follows from the answers

    async def _prepare(self, *, standing: bool = True) -> Look:
        look = await super()._prepare(standing=standing)
        if look.moving and not self._running:
            # An input turns it.
            await self._stand_still()
            look = await super()._prepare(standing=standing)
        if isinstance(look, TlrLook):
            self._check_fault(look.report)
        self._gone = False
        return look

    def _check_fault(self, report: Report) -> None:
        """Raise `DriveFault` where the drive reports one: it would not move."""
        if StatusWord.FAULT in report.status or report.alarm:
            raise DriveFault(f"{self.name} reports {alarm_of(report.alarm or 0) or 'a fault without an alarm'}.")

    def _check_reference(self, look: Look, seen: Look | None) -> None:
        if isinstance(look, TlrLook) and look.restarted:
            raise self._reference_lost()
        if seen is not None and self._driven and self._witness.speaks and not self._near(look.position, seen.position):
            # An input has moved it; it has counted on.
            self._forget()
            seen = None
        super()._check_reference(look, seen)

    def _restarted(self, why: str) -> None:
        """It counts from zero again, and is as it was saved."""
        self._lost = why
        self._gone = True
        self._witness.forget()
        self._energised = self._enabled = None
        self._ready = False
        self._forget()

    def _reference_lost(self) -> ReferenceLost:
        return ReferenceLost(f"{self.name}: {self._lost} enable() it, then home() it or set_zero().")

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

    def _was_interrupted(self, unheard: float, reason: str) -> None:
        self._ready = False
        super()._was_interrupted(unheard, reason)
