"""What is known of axes and buses, as clients are told it."""

from __future__ import annotations

import itertools
from collections import defaultdict
from typing import Any

from rs485bus.bus.bus import Bus
from rs485bus.errors import NoReply, NotSent
from rs485bus.motion.axis import Axis
from rs485bus.motion.sample import AxisSample
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

    async def axis(self, axis: Axis, every: float, **known: Any) -> AxisReport:
        """What is known of an axis, without a number. Its drive is asked for what is older than so many seconds."""
        sample = await _fresh(axis, every) if hasattr(axis, "samples") else await _asked(axis)
        bus = axis.bus
        armed = bus.owner.feeding.get(axis.attached.address)
        return AxisReport(
            n=0,
            at=self._clock.now() if sample.position is None else self._clock.of_loop(sample.at),
            position=sample.position,
            rpm=sample.rpm,
            moving=sample.moving,
            enabled=sample.enabled,
            fault=sample.fault,
            stalled=sample.stalled,
            limit=sample.limit,
            lost=sample.lost,
            watchdog=None if armed is None else armed.timeout,
            connected=bus.connected,
            latched=bus.latched,
            **known,
        )

    def bus(self, name: str, bus: Bus) -> BusReport:
        """Load and errors of a bus."""
        stats = bus.stats
        before, since = self._airtime.get(name, (0.0, 0.0))
        self._airtime[name] = (stats.airtime, stats.elapsed)
        passed = stats.elapsed - since
        return BusReport(
            n=next(self._numbers[name]),
            at=self._clock.now(),
            port=bus.port,
            baudrate=bus.line.baudrate,
            parity=bus.line.parity,
            stopbits=bus.line.stopbits,
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


async def _fresh(axis: Axis, every: float) -> AxisSample:
    samples = axis.samples(every)
    try:
        return await anext(samples)
    finally:
        await samples.aclose()  # type: ignore[attr-defined] # it is a generator


async def _asked(axis: Axis) -> AxisSample:
    """The same of an axis of a family that does not tell by itself what is known of it."""
    at = axis.bus.now()
    moves = axis.motion.may_move
    try:
        position, rpm = await axis.position(), await axis.velocity() if moves else 0.0
    except (NoReply, NotSent):
        return AxisSample(at, 0.0, None, None, None, None, "", False, "", "")
    return AxisSample(at, 0.0, position, rpm, moves, None, "", False, "", "")
