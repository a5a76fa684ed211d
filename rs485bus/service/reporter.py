"""Publishes what is known of axes and buses: states that are retained, and samples at the rate that was asked for."""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from rs485bus.motion.axis import Axis
from rs485bus.service.clock import Clock
from rs485bus.service.decisions import Order
from rs485bus.service.desk import Desk
from rs485bus.service.machine import Performance, Plant
from rs485bus.service.schema import AxisEvent, AxisReport
from rs485bus.service.topics import Topics
from rs485bus.service.traffic import Traffic
from rs485bus.service.verbs import ReadingAlong, Sampling
from rs485bus.service.watch import Watch

_log = logging.getLogger("rs485bus.service")

_STANDING = 1.0
"""Seconds between two states of what stands and does not change."""
_BUSES = 1.0

Publish = Callable[..., None]


class Reporter:
    """One plant.

    Args:
        plant: whose axes and buses are told of.
        desk: knows who commands them.
        clock: the service's.
        topics: the plant's.
        publish: publishes a message; without `qos=1` it may be lost on a bad connection.
        rate: how often the state of what moves is published, in Hz.
    """

    def __init__(self, plant: Plant, desk: Desk, clock: Clock, topics: Topics, publish: Publish, rate: float) -> None:
        self._plant = plant
        self._desk = desk
        self._clock = clock
        self._topics = topics
        self._publish = publish
        self._period = 1 / rate
        self._watch = Watch(clock)
        self._traffic = Traffic(plant.buses, clock, topics, publish)
        self._samplings: dict[str, dict[str, tuple[float, float]]] = {}
        """Of each axis, by client: every how many seconds, and until when."""
        self._numbers: defaultdict[tuple[str, str], itertools.count[int]] = defaultdict(itertools.count)
        self._changed: dict[str, asyncio.Event] = {name: asyncio.Event() for name in plant.axes}
        self._targets: dict[str, tuple[Order, Performance]] = {}

    async def run(self) -> None:
        """Report until cancelled."""
        async with asyncio.TaskGroup() as group:
            for name, axis in self._plant.axes.items():
                group.create_task(self._report(name, axis))
                if hasattr(axis, "events"):
                    group.create_task(self._report_events(name, axis))
            group.create_task(self._report_buses())
            group.create_task(self._traffic.run())

    def began(self, order: Order, performance: Performance) -> None:
        """A verb has begun: what it moves is told at once."""
        for axis in order.axes:
            self._targets[axis] = (order, performance)
        self.touch(order.axes)

    def touch(self, axes: frozenset[str]) -> None:
        """Something of these axes has changed."""
        for axis in axes:
            self._changed[axis].set()

    def subscribe(self, order: Order) -> float | list[str]:
        """Somebody wants samples of an axis for a while, or the traffic of the buses. Returns every how many seconds it
        gets those samples, or the names of the buses."""
        wanted = order.arguments
        if isinstance(wanted, ReadingAlong):
            return self._traffic.want(order.client, wanted.seconds)
        assert isinstance(wanted, Sampling)
        self._samplings.setdefault(order.name, {})[order.client] = (wanted.every, self._clock.now() + wanted.seconds)
        self._changed[order.name].set()
        return self._sampling(order.name) or wanted.every

    def _sampling(self, name: str) -> float | None:
        """Every how many seconds somebody wants a sample; None for nobody."""
        now = self._clock.now()
        wanted = {
            client: (every, until) for client, (every, until) in self._samplings.get(name, {}).items() if until > now
        }
        self._samplings[name] = wanted
        return min((every for every, _ in wanted.values()), default=None)

    async def _report(self, name: str, axis: Axis) -> None:
        loop = asyncio.get_running_loop()
        told: AxisReport | None = None
        at = state_at = loop.time()
        last = float("-inf")
        changed = self._changed[name]
        while True:
            changed.clear()
            sampling = self._sampling(name)
            idle = told is not None and not (told.moving or sampling or axis.motion.may_move)
            every = max(_STANDING, self._period) if idle else min(self._period, sampling or self._period)
            try:
                report = await self._watch.axis(axis, every / 2, **self._known(name))
            except Exception as error:  # whoever looks does not end who serves
                _log.warning("what is known of %s cannot be told: %s", name, error)
                await asyncio.sleep(_STANDING)
                continue
            if sampling is not None:
                self._say(name, "sample", report)
            if at >= state_at and (told is None or _differs(report, told) or at >= last + _STANDING):
                self._say(name, "state", report, retain=True)
                told, last = report, at
                state_at = max(state_at + self._period, at + self._period / 2)
            # A beat that does not drift; one that was missed is left out.
            at = max(at + every, loop.time())
            if await _set_within(changed, at - loop.time()):
                at = state_at = loop.time()

    def _say(self, name: str, what: str, report: AxisReport, *, retain: bool = False) -> None:
        numbered = report.model_copy(update={"n": next(self._numbers[name, what])})
        self._publish(self._topics.axis(name, what), numbered, qos=0, retain=retain)

    def _known(self, name: str) -> dict[str, Any]:
        """What the desk knows of an axis."""
        order = self._desk.under_way(name)
        begun = self._targets.get(name)
        target = begun[1].target if begun is not None and begun[0] is order else None
        return {
            "target": target,
            "verb": None if order is None else order.verb,
            "holder": self._desk.leases.holder(name),
            "stop": self._desk.stops.last(name),
        }

    async def _report_events(self, name: str, axis: Axis) -> None:
        async for event in axis.events():
            at = self._clock.of_loop(event.at)
            said = AxisEvent(at=at, axis=name, event=event.kind.value, what=event.what)
            self._publish(self._topics.axis(name, "event"), said)
            self._changed[name].set()

    async def _report_buses(self) -> None:
        while True:
            for name, bus in self._plant.buses.items():
                self._publish(self._topics.bus(name), self._watch.bus(name, bus), qos=0, retain=True)
            await asyncio.sleep(_BUSES)


def _differs(one: AxisReport, other: AxisReport) -> bool:
    return one.model_copy(update={"at": other.at}) != other


async def _set_within(event: asyncio.Event, seconds: float) -> bool:
    """Wait until an event is set, for so long at most."""
    try:
        async with asyncio.timeout(seconds):
            await event.wait()
    except TimeoutError:
        return False
    return True
