"""Slaves of our own: one that stamps what it reads out, and a small MKS drive written from the manual alone."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from tests.endings.cable import Reply, Sent, framed

FORBIDDEN = 0x4000
"""From this register on a plain slave says no (exception 02)."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """How a slave meets one request.

    kind: "ok", "deaf" (never heard), "lost" (done, no reply), "late" (by `value` seconds), "torn" (`value` of the reply
    arrives), "double", "flip", "before", "after" and "both" (`data` around the reply), "instead" (`data`, done),
    "exception" (code `value`, not done), "done, exception" (code `value`, done).
    """

    kind: str = "ok"
    value: float = 0.0
    data: bytes = b""
    split: int = 0


@dataclass(slots=True)
class Done:
    """A request that a slave carried out or refused."""

    at: float
    sent: Sent
    pdu: bytes
    refused: bool = False
    code: int = 0
    """The exception that was said instead of an answer, whatever was done."""


@dataclass(eq=False)
class Slave:
    """A plain Modbus slave. Whatever is read of it tells which request it was read for."""

    address: int
    by_silence: bool = True
    turnaround: float = 0.002
    dead_until: float = 0.0
    answers_broadcasts: bool = False
    reactions: deque[Reaction] = field(default_factory=deque)
    done: list[Done] = field(default_factory=list)
    stamps: dict[int, Done] = field(default_factory=dict)
    serial: int = 0
    habit: Callable[[bytes], Reaction] | None = None
    """How it meets every request for which nothing else was said."""

    def hear(self, sent: Sent, now: float) -> list[Reply]:
        """Take a frame in and say what comes back."""
        frame = sent.frame
        if now < self.dead_until or framed(frame[:-2]) != frame:
            return []
        reaction = Reaction() if self.habit is None else self.habit(frame)
        if self.reactions and frame[0]:
            reaction = self.reactions.popleft()
        if reaction.kind == "deaf":
            return []
        pdu = frame[1:-2]
        if reaction.kind == "exception":
            self.done.append(Done(now, sent, pdu, refused=True, code=int(reaction.value)))
            return self._say(bytes((self.address, pdu[0] | 0x80, int(reaction.value))), reaction)
        answer = self.carry_out(pdu, sent, now)
        if frame[0] == 0 and not self.answers_broadcasts:
            return []
        if reaction.kind == "done, exception":
            self.done[-1].code = int(reaction.value)
            return self._say(bytes((self.address, pdu[0] | 0x80, int(reaction.value))), reaction)
        if frame[0] == 0:
            return self._say(bytes(1) + answer, reaction)
        return self._say(bytes([self.address]) + answer, reaction)

    def carry_out(self, pdu: bytes, sent: Sent, now: float) -> bytes:
        """Do what a request says; return function and data of the answer."""
        register = int.from_bytes(pdu[1:3], "big")
        known = pdu[0] in (3, 4, 6, 16)
        if not known or register >= FORBIDDEN:
            self.done.append(Done(now, sent, pdu, refused=True))
            return bytes((pdu[0] | 0x80, 2 if known else 1))
        done = Done(now, sent, pdu)
        self.done.append(done)
        if pdu[0] in (3, 4):
            count = int.from_bytes(pdu[3:5], "big")
            self.serial = (self.serial + 1) % 0x10000
            self.stamps[self.serial] = done
            words = [self.serial, *(mark(self.address, register + at, self.serial) for at in range(1, count))]
            return bytes((pdu[0], 2 * count)) + b"".join(word.to_bytes(2, "big") for word in words)
        return pdu if pdu[0] == 6 else pdu[:5]

    def _say(self, body: bytes, reaction: Reaction) -> list[Reply]:
        data, delay, kind = framed(body), self.turnaround, reaction.kind
        if kind == "lost":
            return []
        if kind == "late":
            delay += reaction.value
        elif kind == "torn":
            data = data[: int(reaction.value * len(data))]
        elif kind == "double":
            data += data
        elif kind == "flip":
            at = int(reaction.value * len(data)) % len(data)
            data = data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]
        elif kind == "before":
            data = reaction.data + data
        elif kind == "after":
            data += reaction.data
        elif kind == "both":
            data = reaction.data + data + reaction.data
        elif kind == "instead":
            data = reaction.data
        return [Reply(data, delay, min(reaction.split, max(0, len(data) - 1)))] if data else []


def mark(address: int, register: int, serial: int) -> int:
    """What a register says but for the first of a read: it belongs to this unit, this register, this moment."""
    return (address * 7919 + register * 104_729 + serial * 31) & 0xFFFF


class Mks(Slave):
    """A closed-loop stepper by the manual (MKS RTU V1.0.9): moves, stops, refuses inside replies, has a heartbeat.

    It reaches its speed at once and slows down by the ramp of the stop. Positions are counts, 16384 a turn.
    """

    def __init__(self, address: int, *, by_silence: bool = True, turnaround: float = 0.002) -> None:
        super().__init__(address, by_silence, turnaround)
        self.enabled = True
        self.heartbeat = 0.0
        self.heard_at = 0.0
        self.tripped = 0
        self.lies = False
        """Its status says that it stands while it turns, and that it turns while it stands."""
        self._from, self._since, self._speed = 0.0, 0.0, 0.0  # counts, seconds, counts a second
        self._until = float("inf")
        self._ramp = 0.0

    def hear(self, sent: Sent, now: float) -> list[Reply]:
        self.beat(now)
        self.heard_at = now
        return super().hear(sent, now)

    def beat(self, now: float) -> None:
        """The heartbeat's time may have passed (3.2.14)."""
        if self.heartbeat and now > self.heard_at + self.heartbeat:
            over = self.heard_at + self.heartbeat
            if self.moves(over):
                self.tripped += 1
                self._stand(over)

    def position(self, now: float) -> float:
        """Where the shaft is, in counts."""
        end = min(now, self._until)
        passed = max(0.0, end - self._since)
        if self._ramp:
            rest = min(1.0, passed / self._ramp)
            return self._from + self._speed * self._ramp * (rest - rest * rest / 2)
        return self._from + self._speed * passed

    def moves(self, now: float) -> bool:
        """Whether it turns."""
        return self._speed != 0 and now < self._until

    def carry_out(self, pdu: bytes, sent: Sent, now: float) -> bytes:
        function, register = pdu[0], int.from_bytes(pdu[1:3], "big")
        if function == 4 and len(pdu) == 5:
            data = self._read(register, now)
            if data is None or len(data) != 2 * int.from_bytes(pdu[3:5], "big"):
                self.done.append(Done(now, sent, pdu, refused=True))
                return bytes((function | 0x80, 2))
            self.done.append(Done(now, sent, pdu))
            return bytes((function, len(data))) + data
        if function == 6 and len(pdu) == 5:
            took = self._write(register, pdu[3:5], now)
            self.done.append(Done(now, sent, pdu, refused=not took))
            return pdu if took else pdu[:3] + b"\xff\xff"
        if function == 16 and len(pdu) > 6:
            took = self._write(register, pdu[6:], now)
            self.done.append(Done(now, sent, pdu, refused=not took))
            return pdu[:5] if took else pdu[:3] + b"\0\0"
        self.done.append(Done(now, sent, pdu, refused=True))
        return bytes((function | 0x80, 1))

    def _read(self, register: int, now: float) -> bytes | None:
        position = int(self.position(now))
        rpm = int(self._speed * 60 / 16384) if self.moves(now) else 0
        status = 1 if self.moves(now) == self.lies else 3 if self._ramp or self.lies else 4
        words = {
            0x31: position.to_bytes(6, "big", signed=True),
            0x30: (position >> 14).to_bytes(4, "big", signed=True) + (position & 0x3FFF).to_bytes(2, "big"),
            0x32: rpm.to_bytes(2, "big", signed=True),
            0x33: (int(position * 3200 / 16384) & 0xFFFF_FFFF).to_bytes(4, "big"),
            0x34: bytes(2),
            0x39: bytes(4),
            0x3A: int(self.enabled).to_bytes(2, "big"),
            0x3B: b"\x02\x01",
            0x3E: bytes(2),
            0x40: bytes(4),
            0xF1: status.to_bytes(2, "big"),
        }
        return words.get(register)

    def _write(self, register: int, data: bytes, now: float) -> bool:
        if register == 0xF7:  # 7.2.3; one that stands has nothing to stop
            was = self.moves(now)
            self._stand(now)
            return was or True
        if register == 0xF3:
            self.enabled = data[1] == 1
            if not self.enabled:
                self._stand(now)
            return True
        if register == 0x98:
            self.heartbeat = int.from_bytes(data, "big") / 1000
            return True
        if register == 0x92:
            if self.moves(now):
                return False
            self._from = 0.0
            return True
        if register in (0xF4, 0xF5):
            acc, rpm = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
            goal = int.from_bytes(data[4:8], "big", signed=True)
            return self._go(now, acc, rpm, goal + (self.position(now) if register == 0xF4 else 0))
        if register == 0xF6:
            acc, rpm = data[1], int.from_bytes(data[2:4], "big")
            far = 1e12 if data[0] == 0 else -1e12
            return self._go(now, acc, rpm, far)
        return register not in (0xFD, 0xFE)

    def _go(self, now: float, acc: int, rpm: int, goal: float) -> bool:
        if rpm == 0:
            if not self.moves(now):
                return False  # the manual's log: a stop of what stands has the count 0
            slow = abs(self._speed) * 60 / 16384 * (256 - acc) * 50e-6 if acc else 0.0
            if not slow:
                self._stand(now)
            elif not self._ramp:
                self._from, self._since, self._ramp, self._until = self.position(now), now, slow, now + slow
            return True
        if not self.enabled:
            return False
        here = self.position(now)
        speed = rpm * 16384 / 60
        self._ramp = 0.0
        self._from, self._since = here, now
        self._speed = speed if goal >= here else -speed
        self._until = now + abs(goal - here) / speed
        return True

    def _stand(self, now: float) -> None:
        self._from = self.position(now)
        self._since, self._speed, self._until, self._ramp = now, 0.0, float("inf"), 0.0


class Memory(Slave):
    """A slave whose registers hold what was written, so that it can be read back."""

    def __init__(self, address: int, *, by_silence: bool = True) -> None:
        super().__init__(address, by_silence)
        self.words: dict[int, int] = {}
        self.history: list[tuple[float, int, int]] = []
        """When, which register, what was written."""

    def carry_out(self, pdu: bytes, sent: Sent, now: float) -> bytes:
        register = int.from_bytes(pdu[1:3], "big")
        if register >= FORBIDDEN or pdu[0] not in (3, 6, 16):
            return super().carry_out(pdu, sent, now)
        self.done.append(Done(now, sent, pdu))
        if pdu[0] == 3:
            count = int.from_bytes(pdu[3:5], "big")
            words = [self.words.get(register + at, 0) for at in range(count)]
            return bytes((3, 2 * count)) + b"".join(word.to_bytes(2, "big") for word in words)
        data = pdu[3:5] if pdu[0] == 6 else pdu[6:]
        for at in range(0, len(data), 2):
            value = int.from_bytes(data[at : at + 2], "big")
            self.words[register + at // 2] = value
            self.history.append((now, register + at // 2, value))
        return pdu if pdu[0] == 6 else pdu[:5]
