"""What the user holds: one pair of wires, under one event loop."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, Literal, TypeVar, Unpack

from rs485bus.bus.capture_lines import Header
from rs485bus.bus.config import BusConfig
from rs485bus.bus.handle import Handle
from rs485bus.bus.loop_guard import LoopGuard
from rs485bus.bus.owner import Owner
from rs485bus.bus.port import Port
from rs485bus.bus.record import BusStats, Record
from rs485bus.bus.recording import KEEP, MAX_BYTES, BusRecorder, Recording
from rs485bus.bus.requests import AskOptions, Requests
from rs485bus.bus.runner import OwnerRunner
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.schedule.scheduler import Failed, unheeded
from rs485bus.bus.shutdown import Shutdown
from rs485bus.bus.stopping.halt import Halted, Procedure
from rs485bus.bus.unit import Broadcast, Unit, Units
from rs485bus.bus.units.adapter import BusMember, DeviceAdapter, abandon
from rs485bus.bus.units.motion import Motion
from rs485bus.bus.unseen import Unseen
from rs485bus.bus.watchdog.foreign import turn_off
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.bus.watchdog.guarding import EmergencyReport, emergency_stop
from rs485bus.bus.watchdog.releasing import restore_late
from rs485bus.bus.watchdog.report import warn_of, warn_of_strain
from rs485bus.errors import BusClosed, BusError
from rs485bus.transport.interface import Transport
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Register
from rs485bus.wire.timing import LineSettings

T = TypeVar("T")

_log = logging.getLogger("rs485bus")


class Bus:
    """One RS-485 pair. Made by `open_bus`.

    All calls belong to the event loop's thread. From another one: `loop.call_soon_threadsafe(axis.stop)`, or
    `asyncio.run_coroutine_threadsafe(coroutine, loop)`.
    """

    def __init__(self, transport: Transport, config: BusConfig) -> None:
        self.config = config
        self._transport = transport
        self._guard = LoopGuard()
        self._loop = self._guard.loop
        self._owner = Owner(
            transport.line,
            config,
            self._loop.time(),
            gateway=transport.gateway,
            numbered=getattr(transport, "numbered", False),
            native=getattr(transport, "native", False),
        )
        self._owner.feeding.on_escape, self._owner.feeding.on_strain = warn_of, warn_of_strain
        self._owner.stops.on_released = lambda unit: restore_late(self._owner, unit)
        self._pump = OwnerRunner(self._owner, transport, self._loop)
        self._owner.starts.poke = self._pump.run
        self._port = Port(transport, self._owner, self._pump, config)
        self._requests = Requests(self._owner, self._port, self.submit)
        self._shutdown = Shutdown(self._owner, self._pump, self._port, self._loop, config)
        self._units = Units(self)
        self._unseen = Unseen(self._loop)
        self._kept: dict[type, object] = {}
        self._emergency: Handle[EmergencyReport] | None = None
        self._opened_at = self._loop.time()
        self.broadcast = Broadcast(self)

    # What one does with it

    def unit(
        self,
        address: int,
        *,
        reply_timeout: float | None = None,
        pause: float | None = None,
        probe: Register[Any] | Literal[False] | None = None,
        allow_reserved_address: bool = False,
    ) -> Unit:
        """Plain Modbus to the device at `address` (1..247).

        What is given holds for every request to it from now on, whoever sends it; what is not given stays as it was.

        Args:
            address: its address.
            reply_timeout: seconds it may take to begin an answer, 0.001..10; at first what the bus is set to.
            pause: seconds of quiet on the pair that it wants before a request, 0..1; at first what all get.
            probe: a register that may be read at any time to see whether it answers; False where nothing may be read
                unasked, because reading clears something, say.
            allow_reserved_address: 248..255 may be its address, too. The specification reserves them; some devices can
                be set to one.

        Raises:
            ValueError, TypeError: an argument out of its range, or of a wrong type.
            WatchdogInfeasible: a guarded device could not be waited for as long as that while a watchdog is armed.
        """
        unit = self._units.at(address, allow_reserved_address)
        unit.adjust(reply_timeout, pause, probe)
        return unit

    def watchdog(self, *axes: BusMember, timeout: float, lease: float | None = None) -> WatchdogGuard:
        """Arm the watchdogs of some axes, and feed them while a block runs.

        Args:
            axes: what to guard; all that share a device are guarded with it.
            timeout: seconds without a frame after which the device stops its motor by itself.
            lease: seconds within which `renew()` must be called each time, lest the axes are stopped.

        Returns:
            An async context manager. Entering it raises `WatchdogInfeasible` if the devices cannot be fed in time,
            and `WatchdogInUse` if another block guards one of them.

        Raises:
            ValueError: no axis was named.
            NotSupported: a drive has no watchdog.
            LimitExceeded: its register cannot hold the time.
        """
        self.check_thread()
        return WatchdogGuard(self, axes, self._shutdown.members, timeout, lease)

    def emergency_stop(self) -> Handle[EmergencyReport]:
        """Stop every device as fast as it can, and let nothing move until `clear_emergency_stop()`.

        It happens at once, from any task or signal handler, whether the handle is awaited or not. The report says
        which devices were read to stand. Raises `BusClosed` where the bus is closed.
        """
        self.check_thread()
        if self._owner.gate.closed:
            raise BusClosed("The bus is closed: nothing can be stopped by it any more.")
        handle: Handle[EmergencyReport] = Handle("emergency stop")
        self._emergency = handle
        _log.warning("emergency stop")
        # The first stop is on the wire before anybody is told: who is told may do whatever he likes.
        self.start(emergency_stop(self._owner), handle.finish, handle.fail)
        abandon(self._shutdown.members, "an emergency stop was made")
        return handle

    def clear_emergency_stop(self) -> None:
        """Allow motion again, once the report of the emergency stop is there. Each axis then needs `enable()`.

        Raises:
            BusError: the report is not there yet.
        """
        self.check_thread()
        if self._emergency is not None and not self._emergency.done():
            raise BusError("The emergency stop is still being confirmed: await its handle, then clear it.")
        self._owner.gate.latched = False

    @property
    def latched(self) -> bool:
        """Whether an emergency stop holds."""
        return self._owner.gate.latched

    @property
    def closing(self) -> bool:
        """Whether it is being closed, or is closed: nothing is set in motion any more."""
        return self._owner.gate.closing

    @property
    def connected(self) -> bool:
        """Whether the port is there."""
        return self._owner.gate.connected and not self._owner.gate.closed

    @property
    def closed(self) -> bool:
        """Whether it was closed, for good."""
        return self._owner.gate.closed

    @property
    def stats(self) -> BusStats:
        """What happened on the bus since it was opened. Counts go on; copy what you want to keep."""
        stats = self._owner.journal.stats
        stats.airtime = self._owner.pair.airtime
        stats.elapsed = self._loop.time() - self._opened_at
        for address, unit in stats.units.items():
            unit.waits = self._owner.units[address].reply_times.waits()
        stats.silence = self._owner.pair.silence
        stats.echo = self._owner.pair.exchange.echo
        return stats

    @property
    def flight(self) -> list[Record]:
        """The flight recorder: the latest 256 transactions, the oldest first."""
        return list(self._owner.journal.flight)

    def subscribe(self, observer: Callable[[Record], None]) -> Callable[[], None]:
        """Have `observer` called with the record of each transaction. Returns a function that ends that.

        It is called on the event loop, between two frames: it must be quick.
        """
        return self._owner.journal.subscribe(observer)

    def record_to(self, path: str | os.PathLike[str], *, max_bytes: int = MAX_BYTES, keep: int = KEEP) -> Recording:
        """Write what happens on the bus from now on to a capture file, until it is closed, or the recording is.

        `rs485bus explain`, `plot` and `pcap` read it. The bus does not wait for the disk.

        Args:
            path: the file. A capture that is there already is kept, as `path.1`.
            max_bytes: how long one file may become, 10,000 at the least; then it becomes `path.1`.
            keep: how many older files are kept, 0..1000.

        Raises:
            ValueError: there is a file that is no capture, or an argument is out of its range.
            OSError: the file cannot be written.
        """
        self.check_thread()
        recording = Recording(path, Header.now(self.port, self.line), max_bytes=max_bytes, keep=keep)
        recorder = BusRecorder(recording, self._loop.time(), self._owner.units.family)
        recording.on_close(self.subscribe(recorder))
        self._shutdown.recordings.append(recording)
        return recording

    def on_lost(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Have `callback` called whenever the port is lost. Returns a function that ends that."""
        return self._port.listen(callback)

    async def drain(self) -> None:
        """Wait until no axis has anything queued or moving."""
        self.check_thread()
        for member in self._shutdown.members:
            await member.drain()

    async def aclose(self, *, leave_running: bool | None = None) -> None:
        """Stop every axis that may move, see it stand, release the watchdogs, close the port. In any task.

        It is bounded by `close_timeout`, and not to be cancelled: a cancellation is raised when it is done.

        Args:
            leave_running: leave motors turning; None for what the configuration says.
        """
        if not self._shutdown.done:
            self.check_thread()
        await self._shutdown.close(self.config.leave_running if leave_running is None else leave_running)

    @property
    def stopped(self) -> list[Halted]:
        """How each device that might have moved ended up when the bus was closed."""
        return self._shutdown.stopped

    # What facades need

    @property
    def devices(self) -> list[DeviceAdapter]:
        """The devices attached."""
        return self._owner.units.devices

    @property
    def owner(self) -> Owner:
        """The machine inside."""
        return self._owner

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The event loop that it lives in."""
        return self._loop

    @property
    def thread(self) -> int:
        """The thread of that loop, as `threading.get_ident` names it."""
        return self._guard.thread

    @property
    def port(self) -> str:
        """What it was opened on, as people call it."""
        return self._transport.name

    @property
    def line(self) -> LineSettings:
        """How characters travel on the pair."""
        return self._transport.line

    def now(self) -> float:
        """The time on the bus' clock, in seconds: the event loop's."""
        return self._loop.time()

    def attach(self, member: BusMember) -> None:
        """A facade takes its address.

        Raises:
            AddressInUse: there is one already.
        """
        self.check_thread()
        attached = member.attached
        self._owner.units.attach(attached)
        self._shutdown.members.append(member)
        if self.config.foreign_watchdog == "off":
            self._owner.now = self._loop.time()
            turn_off(self._owner, attached)
            self._pump.run()

    def submit(self, job: Job) -> None:
        """Put a job into the queue; it goes out at once if the wire is free."""
        self._guard.check()
        self._owner.submit(job, self._loop.time())
        self._pump.look()

    def ask(self, request: Request, **options: Unpack[AskOptions]) -> Coroutine[Any, Any, bytes]:
        """Send a request; the coroutine returns the frame that answers it. See `Requests.ask`."""
        return self._requests.ask(request, **options)

    def start(self, procedure: Procedure[T], done: Callable[[T], None], failed: Failed = unheeded) -> None:
        """Have the owner carry out a procedure that nothing can cancel. One that raises has `failed`."""
        self.check_thread()
        self._owner.now = self._loop.time()
        self._owner.start(procedure, done, failed)
        self._pump.run()

    def halt(
        self,
        attached: DeviceAdapter,
        motion: Motion,
        *,
        emergency: bool = False,
        frames: tuple[Request, ...] | None = None,
        told: Callable[[Halted], None],
    ) -> None:
        """Stop a device, or the part of it named, until it is seen standing."""
        self.check_thread()
        self._owner.now = self._loop.time()
        halt = self._owner.stops.halt(self._owner.units[attached.address], motion, emergency=emergency, frames=frames)
        halt.listen(told)
        self._pump.run()

    def heard_after(self, requests: Sequence[Request]) -> list[float]:
        """When each of some frames that go out as one will have been understood, in seconds from the first one's
        begin."""
        return self._owner.starts.heard_after(requests, self.flight)

    def after_stops(self, callback: Callable[[], None]) -> None:
        """Call back as soon as all stops that wait are on the wire; before long, too, where they cannot go out."""
        self._pump.after_stops(callback)

    def spawn(self, coroutine: Coroutine[Any, Any, None], name: str) -> asyncio.Task[None]:
        """A task of the bus' own, outside of any task group."""
        return self._shutdown.spawn(coroutine, name)

    def call_at(self, when: float, callback: Callable[[], None]) -> None:
        """Have the owner call back when the time has come. Nothing can cancel that."""
        self._owner.at(when, callback)
        self._pump.look()

    def keep(self, kind: type[T], make: Callable[[], T]) -> T:
        """The one object of a kind that a layer above keeps for this bus; made when it is first asked for."""
        kept = self._kept.get(kind)
        if kept is None:
            kept = self._kept[kind] = make()
        assert isinstance(kept, kind)
        return kept

    def poke(self) -> None:
        """The owner has something new to wait for."""
        self._pump.run()

    def after(self, seconds: float, callback: Callable[[], None]) -> asyncio.TimerHandle:
        """Call back after so many seconds."""
        return self._loop.call_later(seconds, callback)

    def unseen(self, handle: Handle[Any]) -> None:
        """A command failed. It is logged, and raised from the block, unless somebody sees it."""
        self._unseen.add(handle)

    def failures(self) -> list[Exception]:
        """The failures that nobody has seen, each once."""
        return self._unseen.errors()

    def check_thread(self) -> None:
        """Refuse a call that the event loop of the bus cannot carry out.

        Raises:
            WrongThread: it comes from another thread than the loop's.
            LoopNotRunning: it comes from the loop's thread, but the loop does not run.
            BusClosed: the loop was closed.
        """
        self._guard.check()

    def received(self, data: bytes) -> None:
        """Bytes came in."""
        self._pump.received(data)

    async def open(self) -> None:
        """Open the transport. For `open_bus`."""
        try:
            await self._port.open()
        except BaseException:
            self._pump.close()
            raise
        self.spawn(self._shutdown.keep(), "rs485bus keeper")
        self._pump.run()
