"""The counters of both wheels of a drive, as whoever asked it was told last: what odometry is made of."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

from rs485bus.bus.bus import Bus
from rs485bus.devices.zlac.drive import ZlacDrive
from rs485bus.devices.zlac.values import ControlMode
from rs485bus.errors import BusError
from rs485bus.motion.knowledge import AxisKnowledge
from rs485bus.motion.state import FRESH, Fact


@dataclass(frozen=True, slots=True)
class Counts:
    """Both wheels at one moment: the left one first, positive ahead."""

    at: float
    """The earliest time at which they can have been asked for."""
    counts: tuple[int, int]
    rpm: tuple[float, float]


class Counters:
    """The counters of both wheels.

    Args:
        bus: the bus the drive is on.
        drive: the drive.
        signs: 1 or -1 for each wheel: which way it counts ahead.
        knowledge: what is known of either wheel.
    """

    def __init__(self, bus: Bus, drive: ZlacDrive, signs: tuple[int, int], knowledge: AxisKnowledge) -> None:
        self._bus = bus
        self._drive = drive
        self.signs = signs
        self._knowledge = knowledge
        self._finding_out = False

    def listen(self, listener: Callable[[], None]) -> None:
        """Call back whenever the drive was heard."""
        self._drive.state.listen(listener)

    def now(self) -> float:
        """The time on the event loop's clock."""
        return self._bus.now()

    @property
    def counts_per_turn(self) -> tuple[int, int]:
        """Of each wheel."""
        left, right = (ability.counts_per_turn for ability in self._drive.abilities)
        return left, right

    @property
    def fastest(self) -> float:
        """rpm that a wheel may have."""
        return self._drive.abilities[0].speed_limit

    @property
    def zeroings(self) -> tuple[int, int]:
        """How often each counter may have begun anew, because it was told to."""
        left, right = self._drive.zeroings
        return left, right

    @property
    def restarts(self) -> int:
        """How often the drive was seen to have restarted."""
        return self._drive.restarts

    async def ask(self) -> None:
        """Have the drive tell its counters now, and first whether it has restarted, where it was silent."""
        since = self._bus.now()
        await self._knowledge.see_restart()
        await self._knowledge.know((Fact.POSITION,), since=since)

    def seen(self) -> Counts | None:
        """What was told last; None while it is not known, or not whether the drive has restarted since."""
        left, right = self._drive.state.axes
        positions, speeds = (left.known(Fact.POSITION), right.known(Fact.POSITION)), (left, right)
        if positions[0].value is None or positions[1].value is None or positions[0].at != positions[1].at:
            return None
        if left.last(Fact.MARK).at < self._drive.state.gap_at:
            self._find_out()
            return None
        rpm = [sign * float(axis.last(Fact.SPEED).value or 0.0) for sign, axis in zip(self.signs, speeds, strict=True)]
        counts = [sign * known.value for sign, known in zip(self.signs, positions, strict=True)]
        return Counts(positions[0].at, (counts[0], counts[1]), (rpm[0], rpm[1]))

    def _find_out(self) -> None:
        """Ask whether the drive has restarted while it was not heard."""

        async def find_out() -> None:
            with contextlib.suppress(BusError):
                await self._knowledge.see_restart()
            self._finding_out = False

        if not self._finding_out and self._bus.connected:
            self._finding_out = True
            self._bus.spawn(find_out(), f"rs485bus {self._drive.name} restart")

    def may_have_restarted(self, at: float, before: tuple[int, int], seen: Counts) -> bool:
        """Whether a drive that is in no mode, which shows no restart by that, was silent and counts from zero now."""
        jump = self._drive.state.axes[0].jump
        silent = seen.at > at + FRESH and self._drive.mode is ControlMode.UNDEFINED
        return silent and max(map(abs, seen.counts)) <= jump < max(map(abs, before))
