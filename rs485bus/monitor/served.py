"""Reads along on a plant that is served over a broker, by what its service tells. Stops go through the service."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable

from rs485bus.bus.capture_lines import Exchange, read_entry
from rs485bus.errors import BusError
from rs485bus.monitor.snapshot import NOWHERE, AxisSight, BusLedger, BusSight, Place, Snapshot, state_of
from rs485bus.remote import RemoteAxis, RemotePlant
from rs485bus.service.schema import AxisReport, TrafficReport
from rs485bus.service.topics import PLANT
from rs485bus.wire.timing import LineSettings

EVERY = 0.2
"""Seconds between two samples of an axis."""
_ASKED_FOR = 10.0
"""Seconds for which samples and traffic are asked for at a time."""
_NEWS = 30.0
"""Seconds for which bad news is shown."""
_OLD = 2.0
"""Seconds after which what is known of an axis is called old."""
_HARMLESS = ("stop", "stopped", "back", "control taken", "control ended")
"""Events that are no bad news."""


class ServedWatcher:
    """Watches the axes and buses of a served plant, as `Watcher` does those of this program.

    Args:
        plant: the plant.
        every: seconds between two samples of an axis.
    """

    def __init__(self, plant: RemotePlant, every: float = EVERY) -> None:
        self._plant = plant
        self._every = every
        self._ledgers = {name: BusLedger(LineSettings(baudrate=115200)) for name in plant.description.buses}
        for name, ledger in self._ledgers.items():
            facts = (axis.facts for axis in plant.axes.values())
            ledger.families.update((each.address, each.family) for each in facts if each.bus == name)
        self._done: dict[str, str] = {}
        """What was last done to each axis from here."""
        self._happened: dict[str, tuple[float, str]] = {}
        """The latest bad news of each axis, and when that was."""
        self.stopped: set[str] = set()
        """Axes that were stopped from here."""
        self.lost: dict[str, int] = dict.fromkeys(self._ledgers, 0)
        """Exchanges of each bus that were not told, or lost on the way."""
        self._told: dict[str, int] = {}
        self._places: dict[str, Place] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def start(self) -> None:
        """Begin."""
        self._plant.session.on_traffic.append(self._see)
        self._plant.session.on_report.append(self._note)
        self._spawn(self._ask_for_traffic())
        for name, axis in self._plant.axes.items():
            self._spawn(self._sample(axis))
            self._spawn(self._follow(name, axis))

    async def aclose(self) -> None:
        """End."""
        with contextlib.suppress(ValueError):
            self._plant.session.on_traffic.remove(self._see)
            self._plant.session.on_report.remove(self._note)
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    # What it does

    def stop(self, name: str) -> None:
        """Stop one axis."""
        self._stop([name], self._plant.axes[name].stop(), "stopping")

    def stop_all(self) -> None:
        """Stop all axes, each by its ramp."""
        self._stop(list(self._plant.axes), self._plant.stop(), "stopping")

    def emergency_stop(self) -> None:
        """Stop every drive as fast as it can; nothing moves until the emergency stop is cleared."""
        self._stop(list(self._plant.axes), self._plant.emergency_stop(), "emergency stop")

    def _stop(self, names: list[str], stopping: Awaitable[object], what: str) -> None:
        self.stopped.update(names)
        self._done.update(dict.fromkeys(names, what))

        async def confirm() -> None:
            try:
                await stopping
            except BusError as error:
                self._done.update(dict.fromkeys(names, f"NOT SEEN STANDING: {error}"))
            else:
                self._done.update(dict.fromkeys(names, "stopped, stands"))

        self._spawn(confirm())

    # What it sees

    def snapshot(self) -> Snapshot:
        """All that is known now. Times are the service's clock."""
        now = self._plant.session.now()
        return Snapshot(
            now,
            tuple(self._axis(name, axis, now) for name, axis in self._plant.axes.items()),
            tuple(self._bus(name, ledger, now) for name, ledger in self._ledgers.items()),
        )

    def _axis(self, name: str, axis: RemoteAxis, now: float) -> AxisSight:
        report, facts = axis.report or AxisReport(n=0, at=float("-inf")), axis.facts
        ledger = self._ledgers.get(facts.bus)
        drive = None if ledger is None else ledger.drives.get(facts.address)
        rpm = self._places.get(name, NOWHERE).rpm
        heard_at = None if drive is None else drive.heard_at
        margin = None if report.watchdog is None or heard_at is None else report.watchdog - (now - heard_at)
        stalled = "stalled" if report.stalled else ""
        wrong = "; ".join(filter(None, (report.fault, stalled, report.limit, report.lost)))
        happened_at, happened = self._happened.get(name, (float("-inf"), ""))
        return AxisSight(
            name=name,
            state=state_of(
                connected=report.connected and self._served,
                silent=ledger is not None and ledger.is_silent(facts.address),
                latched=report.latched,
                wrong=wrong,
                known=now - report.at <= _OLD,
                moving=report.moving,
                rpm=rpm,
                enabled=report.enabled,
            ),
            position=report.position,
            unit=facts.unit,
            target=report.target,
            rpm=rpm,
            set_point=None,
            margin=margin,
            watchdog=report.watchdog,
            notice="; ".join(
                filter(None, (wrong, happened if now - happened_at <= _NEWS else "", self._done.get(name, "")))
            ),
        )

    def _bus(self, name: str, ledger: BusLedger, now: float) -> BusSight:
        report = self._plant.buses.get(name)
        if report is not None:
            ledger.line = LineSettings(baudrate=report.baudrate, parity=report.parity, stopbits=report.stopbits)
        port = f"{name} by {self._plant.description.host}" if report is None else report.port
        connected = self._served and report is not None and report.connected
        return ledger.sight(name, port, connected=connected, now=now)

    @property
    def _served(self) -> bool:
        return self._plant.session.connected.is_set() and self._plant.session.served

    # How it looks

    def _note(self, name: str, report: AxisReport) -> None:
        """Something was said of an axis."""
        before = self._places.get(name, NOWHERE)
        if report.at > before.at:
            units_per_turn = self._plant.axes[name].facts.units_per_turn
            rpm = before.speed(report.at, report.position, units_per_turn)
            self._places[name] = Place(report.at, report.position, rpm)

    def _see(self, bus: str, traffic: TrafficReport) -> None:
        """The service has told what happened on a bus."""
        ledger = self._ledgers[bus]
        told = self._told.get(bus, traffic.before)
        self.lost[bus] += max(0, traffic.before - told)
        self._told[bus] = traffic.before + len(traffic.lines)
        for exchange in exchanges(traffic):
            ledger.take(exchange)

    async def _ask_for_traffic(self) -> None:
        session = self._plant.session
        await session.hear_traffic()
        while True:
            with contextlib.suppress(BusError):
                await session.ask(PLANT, "traffic", {"seconds": _ASKED_FOR}, "traffic").wait()
            await asyncio.sleep(_ASKED_FOR / 2)

    async def _sample(self, axis: RemoteAxis) -> None:
        async for _ in axis.samples(self._every):
            pass

    async def _follow(self, name: str, axis: RemoteAxis) -> None:
        async for event in axis.events():
            if event.event == "back":
                self._happened.pop(name, None)
            elif event.event not in _HARMLESS:
                self._happened[name] = event.at, f"{event.event}: {event.what}"

    def _spawn(self, coroutine: Awaitable[None]) -> None:
        task = asyncio.ensure_future(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def exchanges(traffic: TrafficReport) -> list[Exchange]:
    """What a service has told, with the times of its clock."""
    entries = (read_entry(line) for line in traffic.lines)
    return [entry for entry in entries if isinstance(entry, Exchange)]
