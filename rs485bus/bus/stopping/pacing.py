"""How often a device is stopped that does not stand yet. Pure."""

from __future__ import annotations

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.line.serial_line import STOP_WAITS, SerialLine
from rs485bus.bus.stopping.halt import STOPS
from rs485bus.bus.units.unit_state import SILENT, UnitState
from rs485bus.bus.units.unit_states import UnitStates
from rs485bus.bus.watchdog.feeding import Feeding

_TRY_AGAIN_AFTER = 0.5
"""Seconds after which a device is stopped again at the earliest that could not be seen standing."""
_URGENT_EVERY = 0.1
"""The same, at the latest, while nothing but stops is sent to it and it is not heard: what does not hear is not fed."""
_BRIEF = 0.04
"""Seconds for which an answer of such a device is waited for, so that there is time for a stop and a look. No shorter
than it is known to take."""
_BRIEFEST = 0.01
"""The same once it was said that it could not be seen standing: others need the pair. Now and then it is given its
time."""
_PATIENT = 5
"""Attempts to one that is not heard of which one is given the time that it may take."""
_FRAMES = 21
"""Bytes of a stop or a look, with its answer, at most."""
_ROUND = 2
"""A stop and a look."""
_FEW = 6
"""Devices that can be stopped at once with a look at two positions of each, and the last be seen to stand in time."""
_FEW_AMONG_NOISE = 2
"""The same on a noisy pair, on which a look waits for silence."""
_IN_VAIN = 1.0
"""Seconds, at least, for which a device is stopped that may not be heard, before it is said that this was in vain."""


class StopPacing:
    """The pace of the stops to one device.

    Args:
        unit: its address.
        feeding: the watchdogs.
        pair: the pair it is on.
        units: all addresses.
    """

    __slots__ = ("_feeding", "_pair", "_unit", "_units", "late")

    def __init__(self, unit: UnitState, feeding: Feeding, pair: SerialLine, units: UnitStates) -> None:
        self._unit = unit
        self._feeding = feeding
        self._pair = pair
        self._units = units
        self.late: PendingReplies = unit.late

    def reply_timeout(self, since: float, reported: bool) -> float | None:
        unit = self._unit
        if not unit.is_stops_only or unit.heard_at > since:
            return None
        takes = unit.reply_times.longest
        if unit.asked_in_vain % _PATIENT == _PATIENT - 1:
            return min(unit.reply_timeout, max(_BRIEF, takes or unit.reply_timeout))
        return min(unit.reply_timeout, _BRIEFEST if reported else max(_BRIEF, takes))

    @property
    def heard_at(self) -> float:
        return self._unit.heard_at

    def is_noisy(self, now: float) -> bool:
        return self._pair.was_noisy(now)

    def was_noisy_since(self, at: float) -> bool:
        return self._pair.noise_at >= at - STOP_WAITS

    def is_cut_short(self, now: float, since: float) -> bool:
        wait = self.reply_timeout(since, reported=False)
        in_doubt = self._is_in_doubt and self.heard_at > since
        return self.is_noisy(now) or in_doubt or (wait is not None and wait < self._unit.reply_timeout)

    @property
    def _is_in_doubt(self) -> bool:
        """Whether it answers, and it takes many answers to tell its own from late replies."""
        unit = self._unit
        return bool(unit.late.owed) and not unit.late.in_order and unit.asked_in_vain < SILENT

    def is_crowded(self, now: float) -> bool:
        strained = self._feeding.strain.holds and self._feeding.guards_others(self._unit.address)
        return strained or self._stopping > (_FEW_AMONG_NOISE if self.is_noisy(now) else _FEW)

    @property
    def _stopping(self) -> int:
        """How many devices are being stopped."""
        return sum(unit.halt is not None for unit in self._units)

    @property
    def gives_up_after(self) -> float:
        in_turn = 1 if self._unit.asked_in_vain else self._stopping  # it answers, when it has its turn
        return in_turn * self._in_vain + self._unit.late_reply_window * self._is_in_doubt

    @property
    def _in_vain(self) -> float:
        return max(_IN_VAIN, 2 * STOPS * self._unit.reply_timeout)

    @property
    def looks_wait(self) -> float:
        return self._stopping * self._in_vain

    def at_the_latest(self, sent_at: float) -> float:
        unit = self._unit
        guarded = self._feeding.get(unit.address) is not None
        every = _URGENT_EVERY
        if unit.heard_at > sent_at:
            # Where each takes its time, the looks at all of them go before the next round of stops.
            every = max(every, _ROUND * self._stopping * (unit.reply_times.longest + self._pair.line.airtime(_FRAMES)))
        return sent_at + every if unit.is_stops_only and not guarded else float("inf")

    def next_at(self, now: float, sent_at: float, acknowledged: bool) -> float:
        unit = self._unit
        if self.is_noisy(now):
            return now + _URGENT_EVERY
        if not unit.is_stops_only:
            return max(now + _TRY_AGAIN_AFTER, self._units.listening.free_at(now))
        watch = self._feeding.get(unit.address)
        if watch is None or not acknowledged:
            return sent_at + _URGENT_EVERY
        # Its own watchdog is the last defence: no frame may feed it.
        unit.silent_until = now + watch.timeout
        return unit.silent_until
