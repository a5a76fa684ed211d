"""The virtual drive of the made-up family."""

from __future__ import annotations

from rs485bus.sim.device import ILLEGAL_ADDRESS, ILLEGAL_VALUE, Refusal, SimDevice
from rs485bus.sim.motor import Motor
from tests.conformance import acme

_HOME_RPM = 60.0


class SimAcme(SimDevice):
    """A drive, and its shaft.

    Args:
        address: 1..247.
        delay: seconds between a control word and the motion that it starts.
    """

    def __init__(self, address: int, *, delay: float = 0.02) -> None:
        super().__init__(address)
        self.delay = delay
        self.motor = Motor()
        self.origin = 0.0
        self.fault = 0
        self.limit: float | None = None
        self.boots = 1
        self.moves = 0
        self.enabled = False
        self._block = [0, 0, 0, 0]
        self._later: list[tuple[float, int]] = []
        self._at_limit = False
        self._ready_at = 0.0
        self._last = 0.0

    def moving(self, now: float) -> bool:
        self._advance(now)
        return self.motor.moving(now)

    def shaft(self, now: float) -> float:
        """Where the shaft is, in turns."""
        return self.motor.position(now)

    def fail(self, now: float) -> None:
        """Something is wrong: it lets go."""
        self._advance(now)
        self.fault, self.enabled = 7, False
        self._later.clear()
        self.motor.halt(now)

    def restart(self, now: float) -> None:
        """Its supply was gone for a moment."""
        self._advance(now)
        self.fault, self.enabled = 0, False
        self._later.clear()
        self.motor.halt(now)
        self.origin = self.motor.position(now)
        self._block = [0, 0, 0, 0]
        self.boots += 1
        self._ready_at = now + 0.3

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        self._advance(now)
        if now < self._ready_at:
            return None
        function, register = pdu[0], int.from_bytes(pdu[1:3], "big")
        if function == 3:
            count = int.from_bytes(pdu[3:5], "big")
            words = [self._word(at, now) for at in range(register, register + count)]
            return bytes((3, 2 * count)) + b"".join(word.to_bytes(2, "big") for word in words)
        if function == 6 and register == acme.CONTROL:
            self._control(int.from_bytes(pdu[3:5], "big"), now)
            return pdu
        if function == 16 and acme.TARGET <= register < acme.TARGET + 4:
            for at in range(int.from_bytes(pdu[3:5], "big")):
                self._block[register - acme.TARGET + at] = int.from_bytes(pdu[6 + 2 * at : 8 + 2 * at], "big")
            return pdu[:5]
        raise Refusal(ILLEGAL_ADDRESS)

    def _word(self, at: int, now: float) -> int:
        counts = round((self.motor.position(now) - self.origin) * acme.COUNTS)
        moving = self.motor.moving(now)
        status = acme.ENABLED * self.enabled | acme.MOVING * moving | acme.LIMIT * self._at_limit
        status |= acme.FAULT | self.fault << 8 if self.fault else 0
        high, low = divmod(counts & 0xFFFFFFFF, 1 << 16)
        words = [status, high, low, round(self.motor.rpm(now)) & 0xFFFF, self.boots]
        if acme.TARGET <= at < acme.TARGET + 4:
            return self._block[at - acme.TARGET]
        if at >= len(words):
            raise Refusal(ILLEGAL_ADDRESS)
        return words[at]

    def _control(self, word: int, now: float) -> None:
        if word == acme.CLEAR:
            self.fault = 0
        elif word == acme.ENABLE:
            self.enabled = not self.fault
        elif word == acme.DISABLE:
            self.enabled = False
            self.motor.halt(now)
        elif word in (acme.STOP, acme.QUICK_STOP):
            self._later.clear()
            ramp = float(self._block[3] or acme.MIN_RAMP)
            self.motor.run(0, ramp, now) if word == acme.STOP else self.motor.halt(now)
        elif word == acme.ZERO:
            self.origin = self.motor.position(now)
        elif word in (acme.GO, acme.TURN, acme.HOME):
            if not self.enabled:
                raise Refusal(ILLEGAL_VALUE)
            self._later.append((now + (0.0 if self.motor.moving(now) else self.delay), word))
        else:
            raise Refusal(ILLEGAL_VALUE)

    def _advance(self, now: float) -> None:
        while self._later and self._later[0][0] <= now:
            at, word = self._later.pop(0)
            self._begin(word, at)
        if self.limit is not None and self.motor.position(now) >= self.limit and self.motor.rpm(now) > 0:
            self.motor.place(self.limit, now)
            self._at_limit = True
        self._last = now

    def _begin(self, word: int, at: float) -> None:
        high, low, speed, ramp = self._block
        self.moves += 1
        self._at_limit = False
        speed = speed - (1 << 16) if speed >= 1 << 15 else speed
        if word == acme.GO:
            counts = int.from_bytes((high << 16 | low).to_bytes(4, "big"), "big", signed=True)
            self.motor.go_to(self.origin + counts / acme.COUNTS, speed, ramp, at)
        elif word == acme.TURN:
            self.motor.run(speed, ramp, at)
        else:
            self.motor.go_to(-0.5, _HOME_RPM, 1000.0, at)
            self.origin = -0.5
