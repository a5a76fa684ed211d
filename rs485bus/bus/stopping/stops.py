"""Which devices are being stopped, and which must not move until they were armed again. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rs485bus.bus.clock import Clock
from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.schedule.admission import AdmissionControl
from rs485bus.bus.schedule.job import Job, Reason, Urgency, stop_job
from rs485bus.bus.schedule.queue import Queue
from rs485bus.bus.schedule.scheduler import Scheduler
from rs485bus.bus.schedule.timers import Timers
from rs485bus.bus.stopping.halt import Halt
from rs485bus.bus.stopping.pacing import StopPacing
from rs485bus.bus.units.motion import Motion
from rs485bus.bus.units.unit_state import SILENT, UnitState
from rs485bus.bus.units.unit_states import UnitStates
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, Feeding
from rs485bus.wire.frames import Request

_WAITS_FOR_PORT = 1.0
"""Seconds for which a port may be away before it is said that a device could not be seen standing."""

Flush = Callable[[Iterable[Job], Callable[[Job], bool], Reason], None]


class Stops:
    """Stops devices, and says so.

    Args:
        clock: the time.
        pair: the pair.
        queue: what waits for it.
        gate: who may go onto it.
        feeding: the armed watchdogs.
        units: what is known of each address.
        procedures: drives a stop to its end.
        timers: calls back.
        submit: takes a job.
        flush: ends those of some jobs that a condition names, for a reason.
    """

    def __init__(
        self,
        clock: Clock,
        pair: SerialLine,
        queue: Queue,
        gate: AdmissionControl,
        feeding: Feeding,
        units: UnitStates,
        procedures: Scheduler,
        timers: Timers,
        submit: Callable[[Job], None],
        flush: Flush,
    ) -> None:
        self._clock = clock
        self._pair = pair
        self._queue = queue
        self._gate = gate
        self._feeding = feeding
        self._units = units
        self._procedures = procedures
        self._timers = timers
        self._submit = submit
        self._flush = flush
        self.on_released: Callable[[UnitState], None] = lambda unit: None
        """Told that a device stands at last whose watchdog block was left before it did."""

    def halt(
        self, unit: UnitState, motion: Motion, *, emergency: bool, frames: tuple[Request, ...] | None = None
    ) -> Halt:
        """Stop a device, or the part of it named, until it is seen standing. Nothing older that moves it follows.

        On a closed bus that is over at once: nobody has seen it standing.
        """
        attached, halt = unit.attached, unit.halt
        assert attached is not None
        motion.stop()
        if self._gate.closed:
            halt = Halt(attached, motion, emergency, self._clock.now, frames)
            halt.end()
            return halt
        if halt is None:
            halt = unit.halt = Halt(attached, motion, emergency, self._clock.now, frames)
            pacing = StopPacing(unit, self._feeding, self._pair, self._units)
            self._procedures.start(halt.run(pacing), lambda stands: self._halted(unit, stands))
        else:
            waiting = {job.request for job in self._queue.of(unit.address) if job.urgency is Urgency.STOP}
            for request in halt.again(motion, emergency, self._clock.now):
                if request not in waiting:  # else that is as good as a further one
                    self._submit(stop_job(request))
        if not self._gate.connected:
            self.report_if_away(halt)
        # The stops are queued by now; and only this device's jobs are looked at, lest a long queue hold them up.
        self._flush(self._queue.of(unit.address), lambda job: job.is_stale, Reason.STOPPED)
        return halt

    def end_all(self) -> None:
        """Try no more to stop anything. Who still waits is told that it was not seen standing."""
        for unit in self._units:
            if unit.halt is not None:
                unit.halt.end()

    def report_if_away(self, halt: Halt) -> None:
        """Say before long that a device could not be seen standing, where the port stays away. It is stopped first of
        all when it is there again. Closing waits for that."""

        def report() -> None:
            if not self._gate.connected and not self._gate.closing:
                halt.give_up()

        self._timers.at(self._clock.now + _WAITS_FOR_PORT, report)

    def stops_only(self, unit: UnitState) -> None:
        """Nothing but stops to this device until it stands: neither polls nor feeds."""
        unit.is_stops_only = True
        self._feeding.mute(unit.address)

    def restarted(self, unit: UnitState) -> None:
        """The device was seen to have started anew, which whoever saw it tells. Its watchdog register may be back at
        its default: inside of a block it counts as tripped, so that it is armed again before it moves."""
        unit.watchdog_ms = None
        watch = self._feeding.get(unit.address)
        if watch is not None and unit.guarded:
            self._lock(unit, watch, "it has started anew, and its watchdog may be off")

    def trip(self, watch: ArmedWatchdog, reason: str) -> None:
        """The device may have been stopped by its watchdog: it moves only after it was armed again."""
        unit = self._units[watch.address]
        assert unit.attached is not None
        if self._clock.now >= watch.over:
            unit.unheard(watch.heard_at, self._clock.now, SILENT)
        self._lock(unit, watch, f"its watchdog may have stopped it: {reason}")
        unit.tell(unit.attached.interrupted, self._clock.now - watch.heard_at, reason)

    def _lock(self, unit: UnitState, watch: ArmedWatchdog, why: str) -> None:
        """It moves only after it was enabled again, and is fed only then."""
        attached = unit.attached
        assert attached is not None
        self._feeding.trip(watch)
        unit.locked = why
        # Outside of a block nothing is armed again; but what can be read to be on is fed again.
        unit.rearm = watch.timeout if unit.guarded or _can_be_read(unit) else None
        attached.motion.stop()
        self._flush(self._queue.of(watch.address), lambda job: job.is_stale, Reason.LOCKED)
        if attached.motion.may_move:
            self.halt(unit, attached.motion, emergency=True)

    def give_up_hopeless(self) -> None:
        """Where devices answer too slowly for all to be fed, stop the slowest instead of starving the others."""
        while (watch := self._feeding.hopeless(self._clock.now)) is not None:
            self.trip(watch, f"it takes {1000 * watch.takes:.0f} ms to be fed now, and cannot be fed in time any more")

    def _halted(self, unit: UnitState, stands: bool) -> None:
        halt, unit.halt = unit.halt, None
        if halt is None or not stands:
            return
        halt.motion.stands(self._clock.now)
        unit.is_stops_only = False
        self._feeding.unmute(unit.address)
        if unit.may_be_armed and not unit.guarded:
            self.on_released(unit)


def _can_be_read(unit: UnitState) -> bool:
    """Whether its watchdog register can."""
    watchdog = None if unit.attached is None else unit.attached.watchdog
    return watchdog is not None and watchdog.read() is not None
