"""A second virtual MKS drive, written from the manual alone, with other readings of what that leaves open.

It shares nothing with `rs485bus.sim.mks`: neither its motion, which is integrated here in small steps, nor its tables.
Source: MKS RTU V1.0.9; the section stands at each reading.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass

from rs485bus.sim.device import SimDevice

STEP = 0.001
TURN = 0x4000
_INFINITE = math.inf
_EASY = 0.7
"""The part of its ramp with which it plans to slow down, so that steps do not take it too far."""
_MOVES = (0xF6, 0xFD, 0xFE, 0xF4, 0xF5)
_LENGTHS = {0x30: 3, 0x31: 3, 0x32: 1, 0x33: 2, 0x34: 1, 0x39: 2, 0x3A: 1, 0x3B: 1, 0x3E: 1, 0x40: 2, 0xF1: 1}
_STOP, _UP, _DOWN, _FULL, _HOMING = 1, 2, 3, 4, 5


class No(Exception):
    """It says no: 0xFFFF, or a count of 0 (2.4)."""


@dataclass(frozen=True, slots=True)
class Reading:
    """How the open places are read."""

    starts_for: float = 0.6
    """Seconds that it needs when it is switched on; the manual says nothing."""
    on_at_start: bool = True
    """It is energised then (9.4.3 moves without enabling; 7.2.2 says the command decides)."""
    stop_of_another_kind: str = "stops"
    """What a speed of 0 does in another command than the one that runs (8.2, 9.1.2 to 9.4.2): stops, or refused."""
    idle_stop: str = "refused"
    """What a speed of 0 does while it stands: refused, as 9.1.3 logs it, or taken."""
    move_while_moving: str = "refused"
    """What a relative move does while it moves: refused, or replaces."""
    answers_after: float = 0.003
    """Seconds; the logs show 65 ms (5.4), of which nobody knows whose they are."""
    status_lags: float = 0.0
    """Seconds by which 0xF1 is late."""
    status_fails: float = 0.0
    """How often 0xF1 answers 0, "query failed" (7.2.1)."""
    counts_every: float = 0.0
    """Seconds between two values of 0x31: it is read from a loop of its own."""
    settles: int = 0
    """Counts by which it stands off, another time each (9.4.3 and 9.4.4 log -1 and +1)."""
    clicks: int = 0
    """Counts by which the shaft moves when it is energised."""
    stop_releases: bool = False
    """An emergency stop lets go of the motor (7.2.3)."""
    homed_late: float = 0.0
    """Seconds after which 0x3B says that it homes (3.1.7)."""
    homing_counts_anew: str = "end"
    """When the coordinate becomes zero in a homing: at its begin, or at its end (5.1)."""
    homes_by_status: bool = True
    """0xF1 says 5 during a homing; else what the motor does."""
    stall_protects_after: float | None = None
    """Seconds of a stall after which the motor is let go of (3.4); None for never."""
    stall_flag_clears: bool = False
    """0x3E falls when the shaft is free again ("loosening the motor shaft", 3.4.4)."""
    start_delay: float = 0.004
    """Seconds from a command to the first step."""
    zero_while_moving: bool = True
    """0x92 is taken while it moves (5.3.5)."""


class OtherMks(SimDevice):
    """One drive. Positions are turns of the machine; counter-clockwise is up (3.1.1)."""

    def __init__(self, address: int, reading: Reading, shaft: float, switch: float, seed: int = 0) -> None:
        super().__init__(address)
        self.reading = reading
        self.turnaround = reading.answers_after
        self.x, self.v = shaft, 0.0
        self.switch = switch
        self.low, self.high = -_INFINITE, _INFINITE
        """Where a limit switch closes."""
        self.blocked = False
        self.moves = 0
        self.microsteps, self.watchdog = 16, 0
        self.homing = (0, 60, False, 0)
        """Direction, speed, limits on, kind."""
        self._rng = random.Random(seed)
        self._now = self._heard = 0.0
        self._awake = 0.0
        self._statuses: list[tuple[float, int]] = []
        self._begin(0.0)

    def _begin(self, now: float) -> None:
        self.v = 0.0
        self.enabled = self.reading.on_at_start
        self.zero, self.error = self.x, 0
        self.stalled = False
        self.homed = 2
        self._command = 0
        self._target: float | None = None
        self._wanted, self._ramp = 0.0, _INFINITE
        self._until = _INFINITE
        self._then: Callable[[], None] | None = None
        self._pending: tuple[float, Callable[[], None]] | None = None
        self._pushed_since: float | None = None
        self._homing_since: float | None = None
        self._counts_at, self._counts = -_INFINITE, 0

    # What happens to it

    def restart(self, now: float) -> None:
        """It is switched off and on."""
        self.advance(now)
        self._begin(now)
        self._awake = now + self.reading.starts_for

    def protect(self) -> None:
        """A protection lets go of the shaft (3.4)."""
        self.stalled, self.enabled = True, False
        self._halt()

    def _halt(self) -> None:
        self.v, self._wanted, self._target, self._pending, self._command = 0.0, 0.0, None, None, 0
        self._then, self._until, self._pushed_since = None, _INFINITE, None
        if self._homing_since is not None:
            self._homing_since, self.homed = None, 2

    @property
    def busy(self) -> bool:
        """Whether it has something to do."""
        return bool(self.v or self._wanted or self._target is not None or self._pending)

    # Time

    def advance(self, now: float) -> None:
        """Let everything happen until now."""
        if not self._now or not self.busy:
            self._now = max(self._now, now)
        while self._now + STEP <= now:
            self._now += STEP
            self._step(self._now)
        status = self._status()
        if not self._statuses or self._statuses[-1][1] != status:
            self._statuses = [*self._statuses[-20:], (now, status)]

    def _step(self, now: float) -> None:
        if self.watchdog and self.busy and now > self._heard + self.watchdog / 1000:
            self._halt()
        if self._pending and now >= self._pending[0]:
            begin, self._pending = self._pending[1], None
            begin()
        if now >= self._until:
            self._wanted, self._until = 0.0, _INFINITE
        before = self.x
        speed = self._speed()
        change = self._ramp * STEP
        self.v = speed if math.isinf(self._ramp) else self.v + max(-change, min(change, speed - self.v))
        if self.blocked and (self.v or self._wanted or self._target is not None):
            self._push(now)
            return
        self.x += self.v * STEP
        self._arrive(before)
        self._meet_switches(before)
        if not self.v and not self._wanted and self._target is None:
            self._command = self._command if self._pending else 0

    def _speed(self) -> float:
        """What it is to have now, in turns a second."""
        if self._target is None:
            return self._wanted
        ahead = self._target - self.x
        fastest = abs(self._wanted)
        if not math.isinf(self._ramp):
            fastest = min(fastest, math.sqrt(2 * _EASY * self._ramp * abs(ahead)))
        return math.copysign(min(fastest, abs(ahead) / STEP), ahead) if ahead else 0.0

    def _arrive(self, before: float) -> None:
        target = self._target
        if target is None:
            return
        crossed = before <= target <= self.x or self.x <= target <= before
        if not crossed and abs(target - self.x) > 1e-6:
            return
        slow = math.isinf(self._ramp) or abs(self.v) <= self._ramp * 4 * STEP + 1e-9
        if not slow:
            return
        self.x, self.v, self._target, self._wanted = target, 0.0, None, 0.0
        self.error = self._rng.randint(-self.reading.settles, self.reading.settles)
        then, self._then = self._then, None
        if then is not None:
            then()

    def _meet_switches(self, before: float) -> None:
        if not self.homing[2] or self._homing_since is not None:
            return
        if (self.x < before and self.x <= self.low) or (self.x > before and self.x >= self.high):
            self._halt()

    def _push(self, now: float) -> None:
        """Something holds the shaft."""
        self.v = 0.0
        self.stalled = True
        if self._homing_since is not None:
            self._halt()
            self.stalled = True
            return
        self._pushed_since = now if self._pushed_since is None else self._pushed_since
        after = self.reading.stall_protects_after
        if after is not None and now >= self._pushed_since + after:
            self.protect()

    def free(self) -> None:
        """Nothing holds the shaft any more."""
        self.blocked, self._pushed_since = False, None
        if self.reading.stall_flag_clears:
            self.stalled = False

    # What it says

    def _status(self) -> int:
        if self._homing_since is not None and self.reading.homes_by_status:
            return _HOMING
        if self.blocked and (self._wanted or self._target is not None):
            return _FULL
        if not self.v:
            return _STOP
        ramping = self._target is not None and abs(self._speed()) < abs(self._wanted)
        if abs(self.v) > abs(self._wanted) + 1e-9 or ramping:
            return _DOWN
        return _FULL if abs(self.v) >= abs(self._wanted) - 1e-9 else _UP

    def _late_status(self, now: float) -> int:
        if self.reading.status_fails and self._rng.random() < self.reading.status_fails:
            return 0
        known = [status for at, status in self._statuses if at <= now - self.reading.status_lags]
        return known[-1] if known else self._status()

    def _position(self, now: float) -> int:
        if now >= self._counts_at + self.reading.counts_every:
            self._counts_at = now
            self._counts = round((self.x - self.zero) * TURN) + (0 if self.v else self.error)
        return self._counts

    def _homed(self, now: float) -> int:
        late = self._homing_since is not None and now < self._homing_since + self.reading.homed_late
        return 2 if late else self.homed

    # The wire

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        self.advance(now)
        if now < self._awake:
            return None
        self._heard = now
        register = int.from_bytes(pdu[1:3], "big")
        if pdu[0] == 4:
            return self._read(register, now) if int.from_bytes(pdu[3:5], "big") == _LENGTHS.get(register) else None
        if pdu[0] not in (6, 16):
            return None
        try:
            if pdu[0] == 6:
                self._write_one(register, int.from_bytes(pdu[3:5], "big"), now)
            else:
                self._write_block(register, pdu[6:], now)
        except No:
            return pdu[:3] + (b"\xff\xff" if pdu[0] == 6 else b"\0\0")
        return pdu[:5]

    def _read(self, register: int, now: float) -> bytes:
        single = {
            0x34: 3,
            0x3A: int(self.enabled),
            0x3B: 0x200 | self._homed(now),
            0x3E: int(self.stalled),
            0xF1: self._late_status(now) if register == 0xF1 else 0,
        }
        if register == 0x34 and self.homing[2]:
            single[0x34] = 2 | int(self.x > self.low)
        if register in single:
            data = single[register].to_bytes(2, "big")
        elif register == 0x30:
            carry, value = divmod(math.floor(self.x * TURN), TURN)
            data = struct.pack(">iH", carry, value)
        elif register == 0x31:
            data = self._position(now).to_bytes(6, "big", signed=True)
        elif register == 0x32:
            data = struct.pack(">h", round(self.v * 60))
        elif register == 0x33:
            data = struct.pack(">I", round((self.x - self.zero) * 200 * self.microsteps) % 2**32)
        else:
            data = struct.pack(">i", 0 if register == 0x39 else 0x10009)
        return bytes((4, len(data))) + data

    def _write_one(self, register: int, value: int, now: float) -> None:
        if register == 0xF3:
            if value and not self.enabled:
                self.x += self.reading.clicks / TURN
            if not value:
                self._halt()
            self.enabled = bool(value)
        elif register == 0xF7:
            self._halt()
            self.enabled = self.enabled and not self.reading.stop_releases
        elif register == 0x92:
            if self.busy and not self.reading.zero_while_moving:
                raise No
            self.zero, self.error, self._counts_at = self.x, 0, -_INFINITE
        elif register == 0x91:
            self._go_home(value, now)
        elif register == 0x3D:
            self.stalled, self._pushed_since = self.blocked and self.stalled, None
        elif register == 0x41:
            self.restart(now)
        elif register == 0x84:
            self.microsteps = value

    def _write_block(self, register: int, data: bytes, now: float) -> None:
        if register == 0x90:
            self.homing = (data[1], int.from_bytes(data[2:4], "big"), bool(data[4]), self.homing[3])
        elif register == 0x94:
            self.homing = (*self.homing[:3], int.from_bytes(data[4:6], "big"))
        elif register == 0x98:
            self.watchdog = int.from_bytes(data[:4], "big")
        elif register in _MOVES:
            self._move(register, data, now)

    def _move(self, register: int, data: bytes, now: float) -> None:
        if register in (0xF6, 0xFD):
            direction, acc, speed = struct.unpack(">BBH", data[:4])
        else:
            acc, speed = struct.unpack(">HH", data[:4])
            direction = 0
        ramp = 20_000 / (256 - acc) / 60 if acc else _INFINITE
        if speed == 0:
            self._slow_down(register, ramp)
            return
        if not self.enabled or self._homing_since is not None:
            raise No
        turns = speed / 60 * (1.0 if self.microsteps in (16, 32, 64) else 16 / self.microsteps)
        if register == 0xF6:
            runs_for = struct.unpack(">I", data[4:8])[0] / 100 if len(data) == 8 else _INFINITE
            self._start(register, now, None, -turns if direction else turns, ramp, runs_for)
            return
        if register in (0xFD, 0xF4) and self.busy and self.reading.move_while_moving == "refused":
            raise No
        way = int.from_bytes(data[4:8], "big", signed=register != 0xFD)
        way = -way if direction else way
        unit = TURN if register in (0xF4, 0xF5) else 200 * self.microsteps
        base = self.x if register in (0xFD, 0xF4) else self.zero
        self._start(register, now, base + way / unit, turns, ramp, _INFINITE)

    def _start(
        self, command: int, now: float, target: float | None, speed: float, ramp: float, runs_for: float
    ) -> None:
        self.moves += 1

        def begin() -> None:
            self._command, self._target, self._wanted, self._ramp, self._then = command, target, speed, ramp, None
            self._until = now + runs_for

        if self.v:
            begin()  # 9.4, note 2
        else:
            self._command = command
            self._pending = (now + self.reading.start_delay, begin)

    def _slow_down(self, command: int, ramp: float) -> None:
        if not self.busy:
            if self.reading.idle_stop == "refused":
                raise No
            return
        if command != self._command and self.reading.stop_of_another_kind == "refused":
            raise No
        if self._pending or math.isinf(ramp):
            self._halt()
        else:
            self._target, self._wanted, self._ramp, self._then = None, 0.0, ramp, None

    # Homing

    def _go_home(self, how: int, now: float) -> None:
        if not self.enabled:
            raise No
        self.moves += 1
        if how == 2:
            self._command, self._target, self._wanted, self._ramp = 0x91, self.zero, 10.0, 20.0
            return
        self._homing_since, self.homed = now, 0
        if self.reading.homing_counts_anew == "begin":
            self.zero = self.x
        direction, rpm, _, _ = self.homing
        up = direction == 1
        if up or self.x <= self.switch:
            # It looks for the switch where there is none, or stands on it: off it first (5.1).
            self._leg(
                self.x + 1000.0 if up else self.switch + 0.05, rpm, lambda: self._leg(self.switch, rpm, self._found)
            )
        else:
            self._leg(self.switch, rpm, self._found)

    def _leg(self, target: float, rpm: int, then: Callable[[], None]) -> None:
        self._command, self._target, self._wanted, self._ramp, self._then = 0x91, target, rpm / 60, _INFINITE, then

    def _found(self) -> None:
        self._homing_since, self.homed = None, 1
        self.zero, self.error, self._counts_at = self.x, 0, -_INFINITE
