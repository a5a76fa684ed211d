"""What the user holds: one pair of wires, under one event loop."""

from __future__ import annotations

import asyncio
import logging
import math
import os
import threading
from collections.abc import Callable, Coroutine, Sequence
from datetime import UTC, datetime
from typing import Any, Literal, TypeVar

from rs485bus.bus.capture_lines import Header
from rs485bus.bus.config import BusConfig
from rs485bus.bus.failure import failure
from rs485bus.bus.handle import Handle, outlast, running_loop, settle
from rs485bus.bus.owner import Owner
from rs485bus.bus.port import Port
from rs485bus.bus.record import BusStats, Record
from rs485bus.bus.recording import KEEP, MAX_BYTES, BusRecorder, Recording
from rs485bus.bus.runner import OwnerRunner
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.schedule.job import Job, Outcome, Urgency
from rs485bus.bus.schedule.verification import Verification
from rs485bus.bus.stopping.closing import shut_down, still_stopping
from rs485bus.bus.stopping.halt import Halted, Procedure
from rs485bus.bus.unit import Broadcast, Unit
from rs485bus.bus.units.adapter import BusMember, DeviceAdapter
from rs485bus.bus.units.broadcast import is_broadcast, moved_by
from rs485bus.bus.units.motion import Motion
from rs485bus.bus.watchdog.foreign import turn_off
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.bus.watchdog.guarding import EmergencyReport, emergency_stop
from rs485bus.bus.watchdog.releasing import restore_late
from rs485bus.bus.watchdog.report import warn_of, warn_of_strain
from rs485bus.errors import AddressInUse, BusClosed, BusError, LoopNotRunning, WrongThread
from rs485bus.transport.interface import Transport
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Register, Repeat
from rs485bus.wire.timing import LineSettings

T = TypeVar("T")

_log = logging.getLogger("rs485bus")

_STOPS_TAKE = 0.5
"""Seconds for which it is waited until stops are on the wire. A device may be left alone for a while."""


class Bus:
    """One RS-485 pair. Made by `open_bus`.

    All calls belong to the event loop's thread. From another one: `loop.call_soon_threadsafe(axis.stop)`, or
    `asyncio.run_coroutine_threadsafe(coroutine, loop)`.
    """

    def __init__(self, transport: Transport, config: BusConfig) -> None:
        self.config = config
        self._transport = transport
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._owner = Owner(
            transport.line,
            config,
            self._loop.time(),
            gateway=transport.gateway,
            numbered=getattr(transport, "numbered", False),
            native=getattr(transport, "native", False),
        )
        self._owner.feeding.on_escape = warn_of
        self._owner.feeding.on_strain = warn_of_strain
        self._owner.stops.on_released = lambda unit: restore_late(self._owner, unit)
        self._pump = OwnerRunner(self._owner, transport, self._loop)
        self._owner.starts.poke = self._pump.run
        self._port = Port(transport, self._owner, self._pump, config)
        self._units: dict[int, Unit] = {}
        self._members: list[BusMember] = []
        self._unseen: list[Handle[Any]] = []
        self._kept: dict[type, object] = {}
        self._tasks: set[asyncio.Task[Any]] = set()
        self._closing: asyncio.Task[None] | None = None
        self._emergency: Handle[EmergencyReport] | None = None
        self._opened_at = self._loop.time()
        self.broadcast = Broadcast(self)
        self._recordings: list[Recording] = []
        self.stopped: list[Halted] = []
        """How each device that might have moved ended up when the bus was closed."""

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
        unit = Unit(self, address, allow_reserved_address=allow_reserved_address)
        unit = self._units.setdefault(unit.address, unit)
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
        for axis in axes:
            if not hasattr(axis, "attached"):
                raise TypeError(f"watchdog() guards axes, not {axis!r}: bus.watchdog(x, y, timeout=1.0)")
        devices = [axis.attached for axis in axes]
        members = [member for member in self._members if member.attached in devices]
        return WatchdogGuard(self, devices, members, timeout, lease)

    def emergency_stop(self) -> Handle[EmergencyReport]:
        """Stop every device as fast as it can, and let nothing move until `clear_emergency_stop()`.

        It happens at once, from any task or signal handler, whether the handle is awaited or not. The report says
        which devices were read to stand.
        """
        self.check_thread()
        if self._owner.gate.closed:
            raise BusClosed("The bus is closed: nothing can be stopped by it any more.")
        handle: Handle[EmergencyReport] = Handle("emergency stop")
        self._emergency = handle
        _log.warning("emergency stop")
        # The first stop is on the wire before anybody is told: who is told may do whatever he likes.
        self.start(emergency_stop(self._owner), handle.finish)
        for member in self._members:
            member.abandon("an emergency stop was made")
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
        started = datetime.now(UTC).isoformat()
        header = Header(port=self.port, line=self.line, started=started)
        recording = Recording(path, header, max_bytes=max_bytes, keep=keep)
        units = self._owner.units

        def family(address: int) -> str | None:
            attached = units[address].attached if address else None
            return None if attached is None else attached.family

        recording.on_close(self.subscribe(BusRecorder(recording, self._loop.time(), family)))
        self._recordings.append(recording)
        return recording

    def on_lost(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Have `callback` called whenever the port is lost. Returns a function that ends that."""
        return self._port.listen(callback)

    async def drain(self) -> None:
        """Wait until no axis has anything queued or moving."""
        self.check_thread()
        for member in self._members:
            await member.drain()

    async def aclose(self, *, leave_running: bool | None = None) -> None:
        """Stop every axis that may move, see it stand, release the watchdogs, close the port. In any task.

        It is bounded by `close_timeout`, and not to be cancelled: a cancellation is raised when it is done.

        Args:
            leave_running: leave motors turning; None for what the configuration says.
        """
        if self._closing is None or not self._closing.done():
            self.check_thread()
        if self._closing is None:
            self._owner.gate.closing = True
            leave = self.config.leave_running if leave_running is None else leave_running
            self._closing = self._loop.create_task(self._close(leave), name="rs485bus closing")
        cancelled = await outlast(self._closing)
        if cancelled is not None:
            raise cancelled
        self._closing.result()

    # What facades need

    @property
    def devices(self) -> list[DeviceAdapter]:
        """The devices attached."""
        return [unit.attached for unit in self._owner.units if unit.attached is not None]

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
        return self._thread

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
        unit = self._owner.units[attached.address]
        if unit.attached is not None:
            raise AddressInUse(
                f"Address {attached.address} has a facade already ({unit.attached.family}). "
                "Use that one in all places; two would not know of each other's moves."
            )
        unit.attach(attached)
        self._members.append(member)
        if self.config.foreign_watchdog == "off":
            self._owner.now = self._loop.time()
            turn_off(self._owner, attached)
            self._pump.run()

    def submit(self, job: Job) -> None:
        """Put a job into the queue; it goes out at once if the wire is free."""
        self.check_thread()
        self._owner.submit(job, self._loop.time())
        self._pump.look()

    def replace(self, job: Job, request: Request) -> bool:
        """Have a job that waits, and was never sent, say something newer to its device. False if it is too late."""
        if job.outcome is not None or job.attempts:
            return False
        job.request = request
        return True

    async def ask(
        self,
        request: Request,
        *,
        urgency: Urgency = Urgency.COMMAND,
        repeat: Repeat = Repeat.SAFE,
        timeout: float | None = None,
        moves: bool = False,
        motion: Motion | None = None,
        reply_timeout: float | None = None,
        pause: float | None = None,
        slot: BurstSlot | None = None,
        verify: Verification | None = None,
        family: str | None = None,
    ) -> bytes:
        """Send a request; return the frame that answers it. Raises as described at `Unit`.

        One with a `slot` goes out with others, as one, and as what starts a group. With `verify` and `repeat=VERIFY` a
        write that is not answered is read back, and repeated where that shows that it was not carried out; empty is
        returned where that shows that it was. `family` names the one that a broadcast is meant for.

        Raises:
            BroadcastConflict: a broadcast is a read, or a device of another family would act on it.
        """
        attached = self._owner.units[request.address].attached
        if is_broadcast(request):
            moves, motion = True, moved_by(request, self.devices, family)
        elif motion is None and moves:
            motion = None if attached is None else attached.motion
        ended = self._loop.create_future()
        job = Job(
            request,
            urgency=urgency,
            repeat=repeat,
            moves=moves,
            motion=motion,
            reply_timeout=reply_timeout,
            pause=pause,
            slot=slot,
            verify=verify,
            expires_at=None if timeout in (None, math.inf) else self._loop.time() + timeout,
            on_end=lambda _: settle(ended, None),
        )
        self.submit(job)
        if job.outcome is None:
            try:
                await ended
            except asyncio.CancelledError:
                self._owner.cancel(job, self._loop.time())
                raise
        if job.outcome is Outcome.REPLY:
            return job.reply
        family, refusals = (None, None) if attached is None else (attached.family, attached.refusals)
        unit = self._owner.units[request.address]
        raise failure(job, self.flight, family, self._port.trouble, self._port.advice, unit.explain, refusals)

    def start(self, procedure: Procedure[T], done: Callable[[T], None]) -> None:
        """Have the owner carry out a procedure that nothing can cancel."""
        self.check_thread()
        self._owner.now = self._loop.time()
        self._owner.start(procedure, done)
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
        called: list[None] = []

        def once() -> None:
            if not called:
                called.append(None)
                callback()

        if self._owner.gate.closed:
            callback()
            return
        self._owner.after_stops(once)
        self._loop.call_later(_STOPS_TAKE, once)
        self._pump.run()

    def spawn(self, coroutine: Coroutine[Any, Any, None], name: str) -> asyncio.Task[None]:
        """A task of the bus' own, outside of any task group."""
        task = self._loop.create_task(coroutine, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

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
        self._unseen.append(handle)
        # Who awaits it goes on first, or gives up in the same moment; who is about to await it has begun by then.
        self._loop.call_soon(self._tell_unseen, handle)

    def _tell_unseen(self, handle: Handle[Any]) -> None:
        if handle.seen:
            self._unseen.remove(handle)
        else:
            _log.error("%s failed: %s", handle.what, handle.error)

    def failures(self) -> list[Exception]:
        """The failures that nobody has seen, each once."""
        errors = [handle.error for handle in self._unseen if not handle.seen and handle.error is not None]
        return list({id(error): error for error in errors}.values())

    # The transport

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
        if self.config.silence is not None:
            _log.warning(
                "%s: %.2f ms of silence between frames, as configured, instead of the %.2f ms of Modbus (t3.5)",
                self._transport.name,
                1000 * self.config.silence,
                1000 * self._transport.line.t35,
            )
        self.spawn(self._keep(), "rs485bus keeper")
        self._pump.run()

    async def _keep(self) -> None:
        """Stand by for the end of the event loop: a bus that was not closed by then stops its motors first."""
        try:
            await self._loop.create_future()
        finally:
            if self._closing is None:
                await self.aclose()

    async def _close(self, leave_running: bool) -> None:
        for member in self._members:
            member.abandon("the bus was closed")
        stopped = self._loop.create_future()
        deadline = self._loop.call_later(self.config.close_timeout, self._give_up, stopped)
        self.start(shut_down(self._owner, leave_running), lambda halted: settle(stopped, halted))
        await outlast(stopped)
        deadline.cancel()
        self.stopped = stopped.result()
        for halted in self.stopped:
            if not halted.standing:
                _log.critical("%s %d was NOT CONFIRMED STANDING when the bus was closed", halted.family, halted.address)
        self._owner.close(self._loop.time())
        self._pump.close()
        for task in tuple(self._tasks):
            if task is not asyncio.current_task():
                task.cancel()
        await outlast(self._loop.create_task(self._port.close()))
        for recording in self._recordings:
            recording.close()

    def _give_up(self, stopped: asyncio.Future[list[Halted]]) -> None:
        settle(stopped, still_stopping(self._owner))

    def check_thread(self) -> None:
        """Refuse a call that the event loop of the bus cannot carry out.

        Raises:
            WrongThread: it comes from another thread than the loop's.
            LoopNotRunning: it comes from the loop's thread, but the loop does not run.
            BusClosed: the loop was closed.
        """
        if running_loop() is self._loop:
            return
        if threading.get_ident() != self._thread:
            raise WrongThread(
                "The bus was called from another thread than its event loop's. From there, what acts when it is called "
                "is loop.call_soon_threadsafe(axis.stop), and what is awaited is "
                "asyncio.run_coroutine_threadsafe(bus.aclose(), loop).result()."
            )
        if self._loop.is_closed():
            raise BusClosed(
                "The event loop of the bus was closed, so that nothing can be asked or stopped by it any more. Open "
                "the bus anew in the loop that runs now, and leave it before that loop ends: async with open_bus(...)."
            )
        raise LoopNotRunning(
            "The event loop of the bus does not run now, so that nothing can be sent: nothing was done. Call the bus "
            "from a coroutine of that loop. In IPython, whose loop runs only while a cell awaits something, write "
            "await bus.emergency_stop(), not bus.emergency_stop(). Motors that must stop now: use the hard-wired stop."
        )
