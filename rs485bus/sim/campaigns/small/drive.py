"""The smallest drive that the owner can stop and see standing: it turns or it stands. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rs485bus.bus.units.adapter import DeviceAdapter, StandstillDetector, WatchdogRegister
from rs485bus.bus.units.motion import Motion
from rs485bus.wire.frames import Request, crc, payload, read_holding, write_single

STATUS, POSITION, START, STOP, WATCHDOG = 0, 1, 10, 11, 12
_CYCLE = 7


class SmallDrive:
    """The device: a start sets it in motion; a stop ends that, and so does its watchdog once that is set."""

    def __init__(self, address: int) -> None:
        self.address = address
        self.turns = False
        self.starts: list[int] = []
        """The values of the starts that it has carried out."""
        self.watchdog_ms = 0
        self.tripped = False
        """Its watchdog has stopped it."""
        self._heard_at = float("-inf")
        self._position = 0

    def advance(self, now: float) -> None:
        """Let happen what its watchdog does until now."""
        if self.watchdog_ms and now - self._heard_at > self.watchdog_ms / 1000:
            self.tripped, self.turns = True, False

    def answer(self, frame: bytes, now: float, *, refuses: bool = False) -> bytes:
        """Do what a frame says; return the answer."""
        self.advance(now)
        self._heard_at = now
        function, register, value = frame[1], frame[3], int.from_bytes(frame[4:6], "big")
        if refuses:
            return _framed(bytes((self.address, function | 0x80, 6)))
        if function == 6:
            if register == START:
                self.turns = True
                self.starts.append(value)
            elif register == STOP:
                self.turns = False
            elif register == WATCHDOG:
                self.watchdog_ms = value
            return frame
        if self.turns:
            self._position = (self._position + 1) % _CYCLE
        words = [int(self.turns), self._position, 0]
        return _framed(bytes((self.address, function, 2 * value)) + _words(words[register : register + value]))


class SmallAdapter(DeviceAdapter):
    """The drive, as its bus knows it."""

    family = "small"

    def __init__(self, address: int) -> None:
        self.address = address
        self.motion = Motion()
        self.watchdog = _Watchdog(address)
        self._reads = (read_holding(address, STATUS, 1), read_holding(address, POSITION, 2))
        self._stop = write_single(address, STOP, 1)

    def reads(self) -> Sequence[Request]:
        return self._reads

    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        return (self._stop,)

    def stopping_time(self, emergency: bool) -> float:
        return 0.05

    def judgement(self, motion: Motion) -> StandstillDetector:
        return _Judgement(self._reads)

    def hears(self, request: Request) -> bool:
        return False

    def on_reply(self, request: Request, reply: bytes, asked_at: float, now: float) -> None:
        """Nobody wants to know."""

    def interrupted(self, unheard: float, reason: str) -> None:
        """Nobody wants to know."""


class _Watchdog(WatchdogRegister):
    register = WATCHDOG
    highest = 0xFFFF

    def __init__(self, address: int) -> None:
        self._address = address

    def write(self, milliseconds: int) -> Request:
        return write_single(self._address, WATCHDOG, milliseconds)


class _Judgement(StandstillDetector):
    def __init__(self, reads: Sequence[Request]) -> None:
        self._reads = reads

    def ask(self, free: Callable[[Request], bool]) -> Request | None:
        return next((request for request in self._reads if free(request)), None)

    def see(self, request: Request, reply: bytes, sent_at: float) -> bool | None:
        if request is not self._reads[0]:
            return None
        self.by_status_alone = False
        return payload(reply) == b"\0\0"


def _words(values: Sequence[int]) -> bytes:
    return b"".join(value.to_bytes(2, "big") for value in values)


def _framed(body: bytes) -> bytes:
    return body + crc(body)
