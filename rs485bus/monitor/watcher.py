"""Reads along on the buses of a plant. It lives in their event loop, and asks at the lowest urgency."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from rs485bus.bus.bus import Bus
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.capture.traces import Trace
from rs485bus.errors import BusError
from rs485bus.monitor.snapshot import AxisSight, BusLedger, BusSight, Place, Snapshot, state_of
from rs485bus.motion.events import Event, EventKind
from rs485bus.plant import Plant

EVERY = 0.2
"""Seconds after which an axis is asked anew."""
_NEWS = 30.0
"""Seconds for which bad news is shown."""
_OLD = 1.0
"""Seconds after which what is known of an axis is called old."""


class WatchedAxis(Protocol):
    """What the monitor needs of an axis."""

    name: str
    attached: DeviceAdapter
    bus: Bus

    @property
    def units_per_turn(self) -> float: ...

    @property
    def reverse(self) -> bool: ...

    def stop(self) -> Awaitable[None]: ...

    async def position(self) -> float: ...

    async def velocity(self) -> float: ...


@dataclass(slots=True)
class _Known:
    """What an axis was last seen to do."""

    at: float = float("-inf")
    position: float | None = None
    rpm: float | None = None
    moving: bool | None = None
    enabled: bool | None = None
    wrong: str = ""


class Watcher:
    """Watches axes and their buses.

    Args:
        buses: by name.
        axes: by name.
        units: what the positions of axes are called, by name; "turns" where nothing is said.
        sides: which of the axes at an address each one is, by name, where there are several.
        every: seconds after which an axis is asked anew.
    """

    def __init__(
        self,
        buses: Mapping[str, Bus],
        axes: Mapping[str, WatchedAxis],
        units: Mapping[str, str] | None = None,
        sides: Mapping[str, str | None] | None = None,
        every: float = EVERY,
    ) -> None:
        self._every = every
        self._buses = buses
        self._axes = axes
        self._units = units or {}
        self._sides = sides or {}
        self._ledgers = {name: BusLedger(bus.line) for name, bus in buses.items()}
        self._known = {name: _Known() for name in axes}
        self._done: dict[str, str] = {}
        """What was last done to each axis from here."""
        self._happened: dict[str, Event] = {}
        """The latest event of each axis that is bad news."""
        self.stopped: set[str] = set()
        """Axes that were stopped from here."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._unsubscribe: list[Callable[[], None]] = []
        self._loop = asyncio.get_running_loop()

    @classmethod
    def of(cls, plant: Plant, every: float = EVERY) -> Watcher:
        """A watcher of a plant that is open."""
        entries = plant.file.axes
        units = {name: entry.unit for name, entry in entries.items()}
        sides = {name: entry.side for name, entry in entries.items()}
        return cls(plant.buses, plant.axes, units, sides, every)

    def start(self) -> None:
        """Begin."""
        for name, bus in self._buses.items():
            ledger = self._ledgers[name]
            ledger.families.update((device.address, device.family) for device in bus.devices)
            for record in bus.flight:
                ledger.add(record)
            self._unsubscribe.append(bus.subscribe(ledger.add))
        for name in self._axes:
            self._spawn(self._look(name))
            self._spawn(self._follow(name))

    async def aclose(self) -> None:
        """End."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    # What it does

    def stop(self, name: str) -> None:
        """Stop one axis."""
        self._spawn(self._stop(name))

    def stop_all(self) -> None:
        """Stop all axes, each by its ramp."""
        for name in self._axes:
            self.stop(name)

    def emergency_stop(self) -> None:
        """Stop every drive on every bus as fast as it can; nothing moves until the emergency stop is cleared."""
        for bus in self._buses.values():
            with contextlib.suppress(BusError):
                bus.emergency_stop()
        self.stopped.update(self._axes)
        self._done.update(dict.fromkeys(self._axes, "emergency stop"))

    async def _stop(self, name: str) -> None:
        self.stopped.add(name)
        self._done[name] = "stopping"
        try:
            await self._axes[name].stop()
        except BusError as error:
            self._done[name] = f"NOT SEEN STANDING: {error}"
        else:
            self._done[name] = "stopped, stands"

    # What it sees

    def snapshot(self) -> Snapshot:
        """All that is known now."""
        now = self._loop.time()
        told = {name: ledger.told() for name, ledger in self._ledgers.items()}
        return Snapshot(
            now,
            tuple(self._axis(name, told, now) for name in self._axes),
            tuple(self._bus(name, now) for name in self._buses),
        )

    def _axis(self, name: str, told: Mapping[str, list[Trace]], now: float) -> AxisSight:
        axis, known = self._axes[name], self._known[name]
        bus = next(name for name, bus in self._buses.items() if bus is axis.bus)
        ledger, address = self._ledgers[bus], axis.attached.address
        drive = ledger.drives.get(address)
        side = self._sides.get(name)
        mine = [trace for trace in told[bus] if trace.address == address and (not side or trace.name.endswith(side))]
        target, set_point = _latest(mine[0], axis) if mine else (None, None)
        return AxisSight(
            name=name,
            state=self._state(axis, known, ledger.is_silent(address), now),
            position=known.position,
            unit=self._units.get(name, "turns"),
            target=target,
            rpm=known.rpm,
            set_point=set_point,
            margin=None if drive is None else drive.margin(now),
            watchdog=drive.watchdog or None if drive is not None else None,
            notice="; ".join(filter(None, (known.wrong, self._news(name, now), self._done.get(name, "")))),
        )

    def _news(self, name: str, now: float) -> str:
        event = self._happened.get(name)
        return "" if event is None or now - event.at > _NEWS else f"{event.kind.value}: {event.what}"

    def _state(self, axis: WatchedAxis, known: _Known, silent: bool, now: float) -> str:
        bus = axis.bus
        return state_of(
            connected=bus.connected and not bus.closed,
            silent=silent,
            latched=bus.latched,
            wrong=known.wrong,
            known=now - known.at <= _OLD,
            moving=known.moving,
            rpm=known.rpm,
            enabled=known.enabled,
        )

    def _bus(self, name: str, now: float) -> BusSight:
        bus, ledger = self._buses[name], self._ledgers[name]
        return ledger.sight(name, bus.port, connected=bus.connected, now=now)

    # How it looks

    async def _look(self, name: str) -> None:
        """Look at an axis again and again."""
        axis, known = self._axes[name], self._known[name]
        while not axis.bus.closed:
            try:
                await _look_on(axis, known, self._every)
            except BusError as error:
                known.wrong = "" if known.at > float("-inf") else str(error)
            await asyncio.sleep(self._every)

    async def _follow(self, name: str) -> None:
        """Hear of what happens to an axis."""
        events = getattr(self._axes[name], "events", None)
        if events is None:
            return
        async for event in events():
            if event.kind is EventKind.BACK:
                self._happened.pop(name, None)
            elif event.kind is not EventKind.STOP:  # which is told of those that were stopped from here
                self._happened[name] = event

    def _spawn(self, coroutine: Awaitable[None]) -> None:
        task = asyncio.ensure_future(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


async def _look_on(axis: WatchedAxis, known: _Known, every: float) -> None:
    """Keep what is known of an axis up to date, as long as it can be asked."""
    samples = getattr(axis, "samples", None)
    if samples is None:
        known.position, known.rpm = await axis.position(), await axis.velocity()
        known.at = asyncio.get_running_loop().time()
        return
    async for sample in samples(every):
        known.rpm = Place(known.at, known.position, known.rpm).speed(sample.at, sample.position, axis.units_per_turn)
        known.at, known.position = sample.at, sample.position
        known.moving, known.enabled = sample.moving, sample.enabled
        stalled = "stalled" if sample.stalled else ""
        known.wrong = "; ".join(filter(None, (sample.fault, stalled, sample.limit, sample.lost)))


def _latest(trace: Trace, axis: WatchedAxis) -> tuple[float | None, float | None]:
    """Where an axis was sent to, or how fast it was told to turn, whichever was said later."""
    sign = -1 if axis.reverse else 1
    target, speed = trace.targets[-1:], trace.set_points[-1:]
    if target and (not speed or target[0].at >= speed[0].at):
        return sign * target[0].value * axis.units_per_turn, None
    return None, sign * speed[0].value if speed else None
