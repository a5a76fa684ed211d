"""A watchdog block: devices armed and fed while it runs, stopped and released when it is left, however it is left."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Literal

from rs485bus.arguments import positive, real
from rs485bus.bus.failure import failure
from rs485bus.bus.handle import outlast, settle
from rs485bus.bus.protocol import BusProtocol
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.stopping.halt import Halted, unconfirmed
from rs485bus.bus.units.adapter import BusMember, DeviceAdapter
from rs485bus.bus.watchdog.feeding import ArmedWatchdog
from rs485bus.bus.watchdog.guarding import Lease, admit_watchdogs, arm, check_watchdog, left_armed, release
from rs485bus.errors import StopUnconfirmed, WatchdogInUse

_log = logging.getLogger("rs485bus")


async def admit_and_arm(bus: BusProtocol, device: DeviceAdapter, timeout: float) -> bool:
    """Arm one device outside of a block, and feed it from then on. False if it could not be armed.

    Raises:
        WatchdogInfeasible: it could not be fed in time.
    """
    admit_watchdogs(bus.owner, [device], timeout)
    armed: asyncio.Future[list[Job]] = asyncio.get_running_loop().create_future()
    bus.start(arm(bus.owner, [device], timeout), lambda failed: settle(armed, failed))
    return not await armed


def warn_of(escape: ArmedWatchdog) -> None:
    """Log that a device was heard only just before its watchdog would have stopped it."""
    _log.warning(
        "unit %d was unheard for %.3f s of the %g s of its watchdog: a margin of %.0f %%, and %d feeds were sent. "
        "It nearly tripped. Use a longer watchdog, and look in bus.stats for what is lost; an event loop that is "
        "blocked feeds nothing.",
        escape.address,
        escape.longest,
        escape.timeout,
        100 * (1 - escape.longest / escape.timeout),
        escape.feeds,
    )


@dataclass(frozen=True, slots=True)
class WatchReport:
    """How one device was fed. Times are seconds."""

    address: int
    timeout: float
    feeds: int
    """Frames sent to feed it."""
    saved: int
    """Frames that other traffic made unnecessary."""
    longest: float
    """The longest time for which it was unheard."""

    @property
    def margin(self) -> float:
        """The part of its time that was left when it was unheard for longest."""
        return 1 - self.longest / self.timeout


class WatchdogGuard:
    """An async context manager over the watchdogs of some devices. Made by `axis.watchdog` and `bus.watchdog`."""

    def __init__(
        self,
        bus: BusProtocol,
        devices: Sequence[DeviceAdapter],
        members: Sequence[BusMember],
        timeout: float,
        lease: float | None,
    ) -> None:
        self._bus = bus
        self._devices = list({device.address: device for device in devices}.values())
        if not self._devices:
            raise ValueError("watchdog() guards nothing: name the axes that it is to guard")
        self._members = members
        self.timeout = real("timeout", timeout)
        for device in self._devices:
            check_watchdog(device, self.timeout)
        self._lease = None if lease is None else Lease(bus.owner, self._devices, positive("lease", lease))

    async def __aenter__(self) -> WatchdogGuard:
        bus, owner = self._bus, self._bus.owner
        for device in self._devices:
            if owner.units[device.address].guarded:
                raise WatchdogInUse(
                    f"{device.family} {device.address} is guarded by another watchdog block. One block per device: "
                    "name all axes in one bus.watchdog(...)."
                )
        admit_watchdogs(owner, self._devices, self.timeout)
        self._hold(True)
        armed = asyncio.get_running_loop().create_future()
        bus.start(arm(owner, self._devices, self.timeout), armed.set_result)
        cancelled = await outlast(armed)
        failed = armed.result()
        if cancelled is not None or failed:
            await self._release()
            if cancelled is not None:
                raise cancelled
            raise failure(failed[0], bus.flight)
        self.renew()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        try:
            if error is None:
                for member in self._members:
                    await member.drain()
        finally:
            halted = await self._release()
        moving = [f"{device.family} {device.address}" for device in halted if not device.standing]
        if moving and error is None:
            raise StopUnconfirmed(
                f"{', '.join(moving)} could not be seen standing. The watchdog stays armed and is not fed, so that the "
                "drive stops by itself. Look at the machine."
            )
        return False

    def renew(self) -> None:
        """The application is alive: the lease, if there is one, holds from now on."""
        self._bus.check_thread()
        if self._lease is not None:
            self._lease.renew(self._bus.now())
            self._bus.poke()

    def report(self) -> list[WatchReport]:
        """How each device has been fed so far.

        A device whose margin falls under a quarter is logged as a warning, too, once, by "rs485bus".
        """
        owner = self._bus.owner
        reports = []
        for device in self._devices:
            watch = owner.feeding.get(device.address)
            if watch is not None:
                now = self._bus.now()
                longest = max(watch.longest, now - watch.heard_at)
                expected = int((now - watch.armed_at) / (watch.timeout / 3))
                saved = max(0, expected - watch.feeds)
                reports.append(WatchReport(device.address, watch.timeout, watch.feeds, saved, longest))
        return reports

    def _hold(self, guarded: bool) -> None:
        for device in self._devices:
            self._bus.owner.units[device.address].guarded = guarded

    async def _release(self) -> list[Halted]:
        """Stop, confirm, restore: the bus' own job. However often the caller is cancelled, it waits for it."""
        bus = self._bus
        if self._lease is not None:
            self._lease.end()
        self._hold(False)
        for member in self._members:
            member.abandon("its watchdog block was left")
        if bus.owner.gate.closed:
            return []  # closing the bus has released it
        released = asyncio.get_running_loop().create_future()
        bus.start(release(bus.owner, self._devices), lambda halted: settle(released, halted))
        bound = bus.after(bus.config.close_timeout, lambda: settle(released, unconfirmed(self._devices)))
        cancelled = await outlast(released)
        bound.cancel()
        if cancelled is not None:
            raise cancelled
        for device in left_armed(bus.owner, self._devices):
            _log.warning(
                "%s %d: its watchdog could not be set back. It is not fed, and would stop the next move: guard it "
                "again, or switch the drive off and on",
                device.family,
                device.address,
            )
        return list(released.result())
