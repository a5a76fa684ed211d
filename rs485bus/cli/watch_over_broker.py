"""`monitor` and `record` with `--broker`: they read along through the service that has the buses."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from rs485bus.bus.capture_lines import Drive, Dropped, Header
from rs485bus.bus.recording import KEEP, MAX_BYTES, Recording
from rs485bus.cli.outputs import check_output
from rs485bus.cli.over_broker import Served
from rs485bus.cli.watch import paths, record_until, show
from rs485bus.monitor.served import ServedWatcher, exchanges
from rs485bus.remote import RemotePlant
from rs485bus.service.schema import TrafficReport
from rs485bus.wire.timing import LineSettings


def run_monitor(served: Served, record: Path | None) -> int:
    """Show a served plant live, until q. Returns the exit code."""

    @asynccontextmanager
    async def watched() -> AsyncIterator[ServedWatcher]:
        async with served.connect() as plant, AsyncExitStack() as stack:
            if record is not None:
                _record_to(plant, record, stack, max_bytes=MAX_BYTES, keep=KEEP)
            yield ServedWatcher(plant)

    return show(watched, lambda: served.plant)


async def run_record(
    served: Served, out: Path, *, every: float, seconds: float | None, max_bytes: int, keep: int
) -> int:
    """Have the axes of a served plant asked again and again, and keep what happens. Returns the exit code."""
    check_output(out)
    return await record_until(
        served.connect(),
        lambda plant, stack: _record_to(plant, out, stack, max_bytes=max_bytes, keep=keep),
        lambda plant: ServedWatcher(plant, every),
        seconds,
    )


def _record_to(plant: RemotePlant, out: Path, stack: AsyncExitStack, *, max_bytes: int, keep: int) -> list[Recording]:
    """Record what the service tells of each bus."""
    since = plant.session.now()
    recordings: dict[str, Recording] = {}
    told: dict[str, int] = {}
    for name, path in paths(out, plant.description.buses).items():
        report = plant.buses[name]
        line = LineSettings(baudrate=report.baudrate, parity=report.parity, stopbits=report.stopbits)
        recording = Recording(path, Header.now(report.port, line), max_bytes=max_bytes, keep=keep)
        recordings[name] = stack.enter_context(recording)
        for axis in plant.axes.values():
            if axis.facts.bus == name:
                recording.put(Drive(axis.facts.address, axis.facts.family))

    def keep_all(name: str, traffic: TrafficReport) -> None:
        lost = traffic.before - told.get(name, traffic.before)
        told[name] = traffic.before + len(traffic.lines)
        for exchange in exchanges(traffic):
            at = exchange.at - since
            if lost > 0:
                recordings[name].put(Dropped(at, lost))
                lost = 0
            first, queued = exchange.first, exchange.queued
            recordings[name].put(
                exchange._replace(
                    at=at,
                    ended=exchange.ended - since,
                    first=None if first is None else first - since,
                    queued=None if queued is None else queued - since,
                )
            )

    plant.session.on_traffic.append(keep_all)
    stack.callback(plant.session.on_traffic.remove, keep_all)
    return list(recordings.values())
