"""A watchdog block: devices armed and fed while it runs, stopped and released when it is left, however it is left."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from types import TracebackType
from typing import Literal

from rs485bus.arguments import elsewhere, positive, real
from rs485bus.bus.async_block import AsyncBlock
from rs485bus.bus.failure import failure
from rs485bus.bus.handle import Handle, outlast, settle
from rs485bus.bus.protocol import BusProtocol
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.bus.stopping.halt import Halted, unconfirmed
from rs485bus.bus.units.adapter import BusMember, DeviceAdapter, abandon
from rs485bus.bus.watchdog.armed import Ledger
from rs485bus.bus.watchdog.arming import Armed, Arming, check_feasible
from rs485bus.bus.watchdog.lease import Lease
from rs485bus.bus.watchdog.releasing import left_armed, release
from rs485bus.bus.watchdog.report import WatchReport, feeds_expected, warn_of, warn_of_strain
from rs485bus.bus.watchdog.settings import check_watchdog
from rs485bus.errors import (
    BusClosed,
    NotGuarding,
    NotSent,
    RequestFailed,
    StopUnconfirmed,
    WatchdogInUse,
    WatchdogNotSupported,
)
from rs485bus.wire.exceptions import Meaning, exception

__all__ = ["WatchReport", "WatchdogGuard", "admit_and_arm", "warn_of", "warn_of_strain"]

_log = logging.getLogger("rs485bus")


async def admit_and_arm(bus: BusProtocol, device: DeviceAdapter, timeout: float) -> bool:
    """Feed a device again that may have tripped. Inside of a watchdog block it is armed for that; outside of one
    nothing is written: it is fed by what its register holds, if that can be read and is on. False if it did not answer.

    Raises:
        WatchdogInfeasible: it could not be fed in time.
    """
    unit = bus.owner.units[device.address]
    arming = Arming(bus.owner, [device], timeout, only_feed=not unit.guarded)
    ended = await _carry_out(bus, arming)
    if unit.rearm is not None and not unit.locked:
        unit.locked = "its watchdog could not be armed again"
    if ended.infeasible is not None:
        raise ended.infeasible
    return not ended.failed


async def _carry_out(bus: BusProtocol, arming: Arming) -> Armed:
    """Arm. A cancellation ends it as soon as nothing of it is on the wire, and is raised then."""
    armed: asyncio.Future[Armed] = asyncio.get_running_loop().create_future()
    bus.start(arming.run(), lambda ended: settle(armed, ended), armed.set_exception)
    try:
        await asyncio.wait([armed])
    except asyncio.CancelledError:
        arming.cancel()
        bus.poke()
        await outlast(armed)
        raise
    return armed.result()


class _Entry:
    """One time that a block is entered."""

    def __init__(self, bus: BusProtocol, devices: Sequence[DeviceAdapter], timeout: float, lease: float | None) -> None:
        self.ledgers = {device.address: Ledger() for device in devices}
        self.lease = None if lease is None else Lease(bus.owner, devices, lease)
        self._owner = bus.owner
        self._timeout = timeout
        self._armed_at = bus.now()

    def hold(self) -> None:
        """Its devices are this block's."""
        for address, ledger in self.ledgers.items():
            self._owner.units[address].ledger = ledger

    def let_go(self) -> None:
        """They are nobody's any more."""
        for address in self.ledgers:
            self._owner.units[address].ledger = None

    def armed(self, now: float) -> None:
        """All of them are armed."""
        self._armed_at = now
        if self.lease is not None:
            self.lease.renew(now)

    def reports(self, now: float) -> list[WatchReport]:
        """How each device was fed until now."""
        expected = feeds_expected(now - self._armed_at, self._timeout)
        return [
            WatchReport(
                address,
                self._timeout,
                ledger.feeds,
                max(0, expected - ledger.feeds),
                ledger.longest_until(now),
                ledger.trips,
            )
            for address, ledger in self.ledgers.items()
        ]


class WatchdogGuard(AsyncBlock):
    """An async context manager over the watchdogs of some devices. Made by `axis.watchdog` and `bus.watchdog`.

    It may be entered again after it was left: each time it has its own lease and its own report, and restores what the
    watchdogs were set to when it was entered.
    """

    _unused = False
    """It was made and not entered: whoever made it takes the drives for guarded."""

    def __init__(
        self,
        bus: BusProtocol,
        axes: Sequence[BusMember],
        members: Sequence[BusMember],
        timeout: float,
        lease: float | None,
    ) -> None:
        for axis in axes:
            if not hasattr(axis, "attached"):
                raise TypeError(
                    f"watchdog() guards axes, not {axis!r}: bus.watchdog(x, y, timeout=1.0){elsewhere(axis)}"
                )
        self._bus = bus
        self._devices = list({axis.attached.address: axis.attached for axis in axes}.values())
        if not self._devices:
            raise ValueError("watchdog() guards nothing: name the axes that it is to guard")
        for device in self._devices:
            if bus.owner.units[device.address].attached is not device:
                raise ValueError(
                    f"{device.family} {device.address} is on another bus than the one that was to guard it: each bus "
                    "guards its own axes. Enter one block for each bus."
                )
        self._members = [member for member in members if member.attached in self._devices]
        self.timeout = real("timeout", timeout)
        for device in self._devices:
            check_watchdog(device, self.timeout)
        self._lease = None if lease is None else positive("lease", lease)
        self._entry: _Entry | None = None
        self._reports: list[WatchReport] = []
        self._unused = True

    def __repr__(self) -> str:
        names = ", ".join(f"{device.family} {device.address}" for device in self._devices)
        return f"<watchdog block of {names}, {'not entered: it guards nothing' if self._entry is None else 'entered'}>"

    def __del__(self) -> None:
        if self._unused:
            _log.warning("%r. Enter it by `async with`; of rs485bus.blocking, by `with`", self)

    async def __aenter__(self) -> WatchdogGuard:
        bus, owner = self._bus, self._bus.owner
        self._unused = False
        bus.check_thread()
        self._check_free()
        check_feasible(owner, self._devices, self.timeout)
        entry = self._entry = _Entry(bus, self._devices, self.timeout, self._lease)
        entry.hold()
        error: BaseException | None = None
        try:
            ended = await _carry_out(bus, Arming(owner, self._devices, self.timeout))
            error = self._failure(ended.failed[0]) if ended.failed else ended.infeasible
            if error is None and owner.gate.closing:
                error = BusClosed("The bus is being closed: nothing is guarded by it any more.")
        except (asyncio.CancelledError, Exception) as failed:
            error = failed
        if error is not None:
            # What was not touched is neither stopped nor asked.
            await self._leave(error, [device for device in self._devices if owner.units[device.address].may_be_armed])
            raise error
        entry.armed(bus.now())
        bus.poke()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        if error is None:
            try:
                await self._drain()
            except BaseException as interrupted:
                await self._leave(interrupted)
                raise
        await self._leave(error)
        return False

    def renew(self) -> None:
        """The application is alive: the lease, if there is one, holds from now on.

        Raises:
            NotGuarding: the block was not entered, or was left.
        """
        self._bus.check_thread()
        if self._entry is None:
            raise NotGuarding(
                "renew() outside of the watchdog block: nothing is guarded by it now. Enter it first: "
                "async with bus.watchdog(...) as guard."
            )
        if self._entry.lease is not None:
            self._entry.lease.renew(self._bus.now())
            self._bus.poke()

    def report(self) -> list[WatchReport]:
        """How each device has been fed so far, trips included; after the block, until it was left.

        A device whose margin falls under a quarter is logged as a warning, too, once, by "rs485bus".
        """
        return list(self._reports) if self._entry is None else self._entry.reports(self._bus.now())

    def _check_free(self) -> None:
        """Raise what keeps the block from being entered."""
        owner = self._bus.owner
        for device in self._devices:
            if owner.units[device.address].guarded:
                raise WatchdogInUse(
                    f"{device.family} {device.address} is guarded by another watchdog block, or was by one that is "
                    "still being left. One block per device: name all axes in one bus.watchdog(...)."
                )
        if owner.gate.closing:
            raise BusClosed("The bus is closed: nothing can be guarded by it any more.")
        if not owner.gate.connected:
            raise NotSent(
                "Nothing was armed: the port is gone. Plug it in again; the bus reopens it by itself. Wait for "
                "bus.connected, then enter the block."
            )

    def _failure(self, job: Job) -> RequestFailed:
        """Why the block could not be entered."""
        device = next(device for device in self._devices if device.address == job.address)
        watchdog = device.watchdog
        refused = job.outcome is Outcome.REFUSED and watchdog is not None and watchdog.set_by(job.request) is not None
        if job.code is not None and exception(job.code).meaning is Meaning.BUSY:
            refused = False
        if not refused or (watchdog is not None and watchdog.read() is not None):
            return failure(job, self._bus.flight)
        return WatchdogNotSupported(
            f"{device.family} {device.address} refused to have its watchdog set: its firmware seems to have none, and "
            "does not notice when the host is gone. Nothing was armed. Update the firmware, or cut its power by a "
            "safety relay that something else watches.",
            code=job.code,
            address=job.address,
            request=job.request.adu,
            attempts=job.attempts,
        )

    async def _drain(self) -> None:
        """Wait until nothing is queued or moving. Where the port stays away nothing will be: that is not waited for."""
        draining = asyncio.ensure_future(self._drain_members())
        try:
            while not draining.done():
                await asyncio.wait([draining], timeout=self._bus.config.close_timeout)
                if not draining.done() and not self._bus.owner.gate.connected:
                    return
            draining.result()
        finally:
            draining.cancel()

    async def _drain_members(self) -> None:
        for member in self._members:
            await member.drain()

    async def _leave(self, error: BaseException | None, devices: Sequence[DeviceAdapter] | None = None) -> None:
        """Stop, confirm, restore: the bus' own job. However often the caller is cancelled, it waits for that, and for
        no longer than a closing bus does. What could not be seen standing is raised, or told with what is raised.

        `devices` are those that were armed; all of them where nothing is said.
        """
        bus, entry = self._bus, self._entry
        devices = self._devices if devices is None else devices
        if entry is None:
            return
        if entry.lease is not None:
            entry.lease.end()
        abandon((each for each in self._members if each.attached in devices), "its watchdog block was left")
        cancelled, halted = None, list[Halted]()
        if not bus.owner.gate.closed:  # else closing the bus has released it
            released: asyncio.Future[list[Halted]] = asyncio.get_running_loop().create_future()

            def done(ended: list[Halted]) -> None:
                entry.let_go()
                settle(released, ended)

            bus.start(release(bus.owner, devices), done, lambda _: done(unconfirmed(devices)))
            bound = bus.after(bus.config.close_timeout, lambda: settle(released, unconfirmed(devices)))
            cancelled = await outlast(released)
            bound.cancel()
            halted = released.result()
        else:
            entry.let_go()
        self._reports, self._entry = entry.reports(bus.now()), None
        self._warn_of_left_armed()
        self._tell(halted, error or cancelled)
        if cancelled is not None and error is None:
            raise cancelled

    def _warn_of_left_armed(self) -> None:
        for device in left_armed(self._bus.owner, self._devices):
            _log.warning(
                "%s %d: its watchdog could not be set back. It is not fed, and would stop the next move: guard it "
                "again, or switch the drive off and on",
                device.family,
                device.address,
            )

    def _tell(self, halted: Sequence[Halted], error: BaseException | None) -> None:
        """Raise that some could not be seen standing; or tell it beside what is raised already."""
        moving = [f"{device.family} {device.address}" for device in halted if not device.standing]
        if not moving:
            return
        failure = StopUnconfirmed(
            f"{', '.join(moving)} could not be seen standing. The watchdog stays armed and is not fed, so that the "
            "drive stops by itself. Look at the machine."
        )
        if error is None:
            raise failure
        error.add_note(str(failure))
        _log.error("a watchdog block was left: %s", failure)
        if not isinstance(error, Exception):
            # Whoever cancels hardly looks at the notes of a cancellation.
            Handle[None]("leaving a watchdog block", self._bus.unseen).fail(failure)
