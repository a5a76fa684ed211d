"""What is known of axes and buses, as clients are told it."""

from __future__ import annotations

import itertools
from collections import defaultdict
from typing import Any

from rs485bus.bus.bus import Bus
from rs485bus.errors import BusError
from rs485bus.service.clock import Clock
from rs485bus.service.schema import AxisReport, BusReport, UnitReport


class Watch:
    """Makes the reports.

    Args:
        clock: the service's.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._numbers: defaultdict[str, itertools.count[int]] = defaultdict(itertools.count)
        self._airtime: dict[str, tuple[float, float]] = {}

    async def axis(self, name: str, axis: Any, **known: Any) -> AxisReport:
        """What is known of an axis, without a number. Its drive is asked where nothing tells by itself."""
        bus: Bus = axis.bus
        facts = await self._facts(axis)
        at = self._clock.now() if facts is None else facts.pop("at")
        return AxisReport(
            n=0,
            at=at,
            connected=bus.connected,
            latched=bus.latched,
            **(facts or {"lost": "its drive does not answer"}),
            **known,
        )

    async def _facts(self, axis: Any) -> dict[str, Any] | None:
        at = self._clock.now()
        try:
            position = await axis.position()
            rpm = await axis.velocity() if axis.motion.may_move else 0.0
        except BusError:
            return None
        return {"at": at, "position": position, "rpm": rpm, "moving": axis.motion.may_move}

    def bus(self, name: str, bus: Bus) -> BusReport:
        """Load and errors of a bus."""
        stats = bus.stats
        before, since = self._airtime.get(name, (0.0, 0.0))
        self._airtime[name] = (stats.airtime, stats.elapsed)
        passed = stats.elapsed - since
        return BusReport(
            n=next(self._numbers[f"bus {name}"]),
            at=self._clock.now(),
            port=bus.port,
            connected=bus.connected,
            latched=bus.latched,
            load=(stats.airtime - before) / passed if passed > 0 else 0.0,
            transactions=stats.transactions,
            units={
                str(address): UnitReport(
                    requests=unit.requests,
                    replies=unit.replies,
                    retries=unit.retries,
                    timeouts=unit.timeouts,
                    refusals=unit.refusals,
                    crc_errors=unit.crc_errors,
                    late_replies=unit.late_replies,
                )
                for address, unit in stats.units.items()
            },
        )
