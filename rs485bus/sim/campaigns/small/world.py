"""The owner among everything that can happen to it: one state machine, moved by single actions. Pure.

Unit 1 is a device with a memory whose every answer tells which request it answers. Unit 2 is a drive that turns or
stands. An action is a letter; a path is a string of them, and says a state.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

from rs485bus.bus.config import BusConfig
from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.burst import Burst, BurstSlot
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.bus.schedule.verification import holds
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.watchdog.arming import Armed, Arming
from rs485bus.bus.watchdog.reckoning import LOST
from rs485bus.sim.campaigns.small.drive import START, SmallAdapter, SmallDrive
from rs485bus.sim.campaigns.small.fingerprint import fingerprint
from rs485bus.wire.frames import Request, crc, read_holding, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from rs485bus.wire.timing import LineSettings

MEMORY, DRIVE = 1, 2
_LINE = LineSettings(baudrate=115200)
_CONFIG = BusConfig(echo=False, reply_timeout=0.03, retries=1, late_reply_window=0.1, offline_after=100)
_ONCE = dataclasses.replace(_CONFIG, retries=0)
_TURNAROUND = 0.002
_MARGIN = 0.005
_MANY = 2000
_LONGEST = 20.0
"""Seconds within which everything must have ended, if from some state on everything is answered."""

WORLDS: dict[str, str] = {
    "stop": "a read, a moving write that must not be repeated, and a stop",
    "verified": "a read, a write that is read back, and a stop",
    "burst": "two moving writes that go out as one, and a stop",
    "two-reads": "two reads of the same looks, and a write",
    "gateway": "two reads of the same looks and a write, behind a gateway",
    "watchdog": "a watchdog that is armed, a moving write that must not be repeated, and a stop",
}
_READS = ("two-reads", "gateway")
_WATCHDOG = 0.4
"""Seconds: three attempts that fail, and some feeds."""
_FED_FOR = 3 * _WATCHDOG
ACTIONS = {
    "1": "the first job is submitted",
    "2": "the second job is submitted",
    "3": "the third job is submitted, or the drive is told to stop",
    "T": "time passes until the owner wants to be woken",
    "R": "the frame is heard and answered",
    "L": "the frame is lost",
    "A": "the frame is heard, and its answer is lost",
    "D": "the frame is heard, and its answer is late",
    "P": "the oldest late answer arrives",
    "X": "the frame is answered by exception 06: busy, nothing was done",
    "N": "a stray byte arrives",
    "C": "the moving job is cancelled",
    "U": "the port is lost",
    "V": "the port is back",
}


@dataclass(slots=True, eq=False)
class _Asked:
    job: Job
    at: int
    """How many stops had been asked for when it was submitted."""
    sent: int = 0
    ends: int = 0
    cancelled: bool = False


class World:
    """One state.

    Args:
        name: one of `WORLDS`.
        path: the actions that lead there.
    """

    def __init__(self, name: str, path: str = "") -> None:
        self.name = name
        self.now = 1000.0
        config = _ONCE if name in _READS else _CONFIG
        self.owner = Owner(_LINE, config, self.now - 1, gateway=name == "gateway")
        self.adapter = SmallAdapter(DRIVE)
        self.owner.units[DRIVE].attach(self.adapter)
        self.drive = SmallDrive(DRIVE)
        self.memory: dict[int, int] = {}
        self.wrong: list[str] = []
        self.asked: list[_Asked | None] = [None, None, None]
        self.stops = 0
        self.halted: list[Halted] = []
        self.armed: list[Armed] = []
        """How arming ended, once it has."""
        self._arms = False
        self._missed = 0
        """Frames in a row that unit 2 has not answered in time."""
        self._moves_since_stop = 0
        self._burst = Burst(2)
        self._frame: bytes | None = None
        self._late: list[tuple[float, bytes]] = []
        """Answers on their way, and by when they arrive if they do: within the window for late replies."""
        self._serial = 0
        self._answered: dict[int, bytes] = {}
        self._heard_at = self._sent_until = self.now - 1
        self._connected = True
        for action in path:
            self.do(action)

    # What can happen

    def actions(self) -> str:
        """What can happen next."""
        begun = (self._arms, False, bool(self.stops))
        can = "".join(str(at + 1) for at in range(3) if self.asked[at] is None and not begun[at])
        if self._frame is not None:
            can += "RLADX" if self._connected else "L"
        elif self.owner.wake < float("inf"):
            can += "T"
        if self._late and self._connected:
            can += "P"
        if self._connected:
            can += "N" * (self._frame is not None) + "U"
        else:
            can += "V"
        moving = self.asked[1]
        if moving is not None and not moving.ends and not moving.cancelled:
            can += "C"
        return can

    def do(self, action: str) -> None:
        """Let one thing happen."""
        if action in "123":
            self._submit(int(action) - 1)
        elif action == "T":
            self._tick(max(self.now, self.owner.wake))
        elif action in "RLADX":
            self._decide(action)
        elif action == "P":
            self._hear(self._late.pop(0)[1])
        elif action == "N":
            self._hear(b"\x55")
        elif action == "C":
            moving = self.asked[1]
            assert moving is not None
            moving.cancelled = True
            self.owner.cancel(moving.job, self.now)
        elif action == "U":
            self._connected = False
            self._late.clear()
            self._frame = None
            self._stopped()
            self.owner.unplugged(self.now)
            self._tick(self.now)  # as the bus does
        elif action == "V":
            self._connected = True
            self.owner.plugged(self.now)
            self._tick(self.now)

    def finish(self) -> None:
        """From here on everything is answered: everything must end, and what is said of the drive must be so."""
        if not self._connected:
            self.do("V")
        if self.name == "burst":
            for at in (0, 1):
                if self.asked[at] is None:
                    self._submit(at)  # one that waits for the others waits for as long as those are to come
        self._go_on(self.now + _LONGEST, lambda: self._all_ended)
        self.wrong += [f"job {at + 1} never ends" for at, one in enumerate(self.asked) if one and not one.ends]
        if len(self.halted) < self.stops:
            self.wrong.append("whoever stopped the drive is never told")
        elif self._arms and not self.armed:
            self.wrong.append("whoever armed the watchdog is never told")
        elif self._is_unwanted and self.drive.turns:
            self.wrong.append("the drive turns in the end, and nobody wants that")
        if self.drive.watchdog_ms and self._missed <= LOST and self.owner.feeding.armed:
            end = self.now + _FED_FOR
            self._go_on(end, lambda: False)
            self.drive.advance(end)
            if self.drive.tripped or self.owner.units[DRIVE].locked:
                self.wrong.append("the drive trips, though all that it is asked is answered")

    def _go_on(self, end: float, is_over: Callable[[], bool]) -> None:
        """Let everything be answered until a time, or until something holds."""
        actions = 0
        while self.now < end and actions < _MANY and not is_over():
            actions += 1
            if self._frame is not None:
                self.do("R")
            elif self._late:
                self.do("P")
            elif self.owner.wake < float("inf"):
                self.do("T")
            else:
                break

    @property
    def _all_ended(self) -> bool:
        stopped = len(self.halted) >= self.stops and not (self._is_unwanted and self.drive.turns)
        told = bool(self.armed) or not self._arms
        return stopped and told and all(one is None or one.ends for one in self.asked)

    @property
    def _is_unwanted(self) -> bool:
        """Whether the drive was stopped, and nobody has wanted it to move since."""
        return self.stops > 0 and self._moves_since_stop == 0

    def fingerprint(self) -> int:
        """The number of this state."""
        mine = (self.owner, self.drive, self.memory, self._late, self._frame, self.asked, self.halted, self.stops)
        more = (self.armed, self._serial, self._connected, self._moves_since_stop, self._heard_at, self._sent_until)
        return fingerprint((mine, more, self._arms, self._missed), self.now)

    # Inside

    def _request(self, at: int) -> tuple[Request, dict[str, object]]:
        read: tuple[Request, dict[str, object]] = read_holding(MEMORY, at, 2), {"repeat": Repeat.SAFE}
        moves: dict[str, object] = {"repeat": Repeat.NEVER, "moves": True, "motion": self.adapter.motion}
        if self.name in _READS:
            return (write_single(MEMORY, 40, 7), {"repeat": Repeat.NEVER}) if at == 2 else read
        if self.name == "burst":
            return write_single(DRIVE, START, at + 1), {**moves, "slot": BurstSlot(self._burst, at)}
        if at == 0:
            return read
        if self.name == "verified":
            return write_multiple(MEMORY, 40, (7, 8)), {
                "repeat": Repeat.VERIFY,
                "verify": holds(MEMORY, 40, (7, 8)),
                "moves": True,
                "motion": self.adapter.motion,
            }
        return write_single(DRIVE, START, 1), moves

    def _submit(self, at: int) -> None:
        if at == 2 and self.name not in _READS:
            self._stop()
            return
        if at == 0 and self.name == "watchdog":
            self._arm()
            return
        request, options = self._request(at)
        job = Job(request, on_end=lambda job: self._ended(at), **options)  # type: ignore[arg-type]
        self.asked[at] = _Asked(job, self.stops)
        self._moves_since_stop += job.moves
        self.owner.submit(job, self.now)

    def _stop(self) -> None:
        self._stopped()
        self.stops += 1
        self.owner.now = self.now
        self.owner.stops.halt(self.owner.units[DRIVE], self.adapter.motion, emergency=True).listen(self._told)
        self._tick(self.now)

    def _arm(self) -> None:
        self._arms = True
        self.owner.now = self.now
        self.owner.start(Arming(self.owner, [self.adapter], _WATCHDOG).run(), self.armed.append)
        self._tick(self.now)

    def _stopped(self) -> None:
        """Nothing older that moves may follow."""
        self._moves_since_stop = 0
        for one in self.asked:
            if one is not None:
                one.at = -1

    def _told(self, halted: Halted) -> None:
        self.halted.append(halted)
        if halted.standing and self.drive.turns and not self._moves_since_stop:
            self.wrong.append("the drive is said to stand, and turns")

    def _tick(self, now: float) -> None:
        self.now = now
        self._late = [(by, answer) for by, answer in self._late if now < by]
        frame = self.owner.tick(now)
        if frame is None:
            return
        start = max(now, self.owner.send_at)
        if start - max(self._heard_at, self._sent_until) < self.owner.pair.silence - 1e-6:
            self.wrong.append(f"a frame too early: {frame.hex(' ')}")
        if not self._connected:
            self.wrong.append("a frame without a port")
        self.drive.advance(start)
        self.now = self._sent_until = start + _LINE.airtime(len(frame))
        self._frame = frame
        self._may_go(frame)

    def _may_go(self, frame: bytes) -> None:
        for at, one in enumerate(self.asked):
            if one is None or one.job.request.adu != frame or one.job.attempts == one.sent:
                continue
            one.sent = one.job.attempts
            if one.ends:
                self.wrong.append(f"job {at + 1} is sent after its end")
            if one.cancelled:
                self.wrong.append(f"job {at + 1} is sent after it was cancelled")
            if one.job.moves and self.drive.tripped:
                self.wrong.append(f"job {at + 1} moves a drive that its watchdog has stopped")
            if one.job.moves and one.at < 0:
                self.wrong.append(f"job {at + 1} moves, is older than a stop, and is sent after it")
            if one.job.repeat is Repeat.NEVER and one.sent > 1:
                self.wrong.append(f"job {at + 1} must not be repeated, and is")

    def _decide(self, action: str) -> None:
        frame, self._frame = self._frame, None
        assert frame is not None
        if frame[0] == DRIVE:
            self._missed = 0 if action in "RX" else self._missed + 1
        if action == "L":
            return
        answer = self._answer(frame, refuses=action == "X")
        if action in "RX":
            self.now += _TURNAROUND
            self._hear(answer)
        elif action == "D":
            by = self._sent_until + _CONFIG.reply_timeout + _CONFIG.late_reply_window - _MARGIN
            self._late.append((by, answer))

    def _answer(self, frame: bytes, refuses: bool) -> bytes:
        if frame[0] == DRIVE:
            return self.drive.answer(frame, self.now, refuses=refuses)
        function, register = frame[1], frame[3]
        if refuses:
            body = bytes((MEMORY, function | 0x80, 6))
        elif function == 3 and register >= 40:
            values = [self.memory.get(register + at, 0) for at in range(frame[5])]
            body = bytes((MEMORY, 3, 2 * frame[5])) + b"".join(value.to_bytes(2, "big") for value in values)
        elif function == 3:
            self._serial += 1
            self._answered[self._serial] = frame
            body = bytes((MEMORY, 3, 2 * frame[5])) + self._serial.to_bytes(4, "big")[: 2 * frame[5]]
        elif function == 6:
            self.memory[register] = int.from_bytes(frame[4:6], "big")
            return frame
        else:
            self.memory.update({register + at: frame[8 + 2 * at] for at in range(frame[5])})
            body = frame[:6]
        return body + crc(body)

    def _hear(self, data: bytes) -> None:
        self.now = max(self.now, self._sent_until) + _LINE.airtime(len(data))
        self._heard_at = self.now
        self.owner.feed(data, self.now)

    def _ended(self, at: int) -> None:
        one = self.asked[at]
        assert one is not None
        one.ends += 1
        job, done = one.job, self._is_done(one.job)
        if one.ends > 1:
            self.wrong.append(f"job {at + 1} ends twice")
        if job.outcome is Outcome.REPLY and not job.request.writes:
            serial = int.from_bytes(job.reply[3:7], "big")
            if self._answered.get(serial) != job.request.adu:
                self.wrong.append(f"job {at + 1} is given the answer to another request")
        elif job.outcome is Outcome.REPLY and not done:
            self.wrong.append(f"job {at + 1} is said to be done, and is not")
        elif job.outcome in (Outcome.REFUSED, Outcome.NOT_SENT) and done and job.request.writes:
            self.wrong.append(f"job {at + 1} is said not to be done, and is")
        elif job.outcome is Outcome.NO_REPLY and job.repeat is Repeat.NEVER and one.job.attempts:
            self.wrong.append(f"job {at + 1} may be repeated, it is said, and must not be")

    def _is_done(self, job: Job) -> bool:
        if job.address == DRIVE:
            return int.from_bytes(job.request.adu[4:6], "big") in self.drive.starts
        return 40 in self.memory
