"""A TL-R drive, as its bus knows it: how it stops and is confirmed. It has no watchdog. Source: TL-R manual."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rs485bus.bus.units.adapter import DeviceAdapter, StandstillDetector
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.frames import control, read
from rs485bus.devices.tlr.telemetry import report
from rs485bus.devices.tlr.values import ControlWord, ExceptionCode
from rs485bus.wire.frames import WRITE_MULTIPLE, WRITE_SINGLE, Request, payload, read_holding

FAMILY = "TL-R"
_STANDS_FOR = 0.05
"""Seconds between two equal positions that show a motor standing of which no speed was read."""
_SAME = 2
_EMERGENCY_STOP_TAKES = 0.1
_LONGEST_RAMP = r.MAX_RAMP_MS / 1000
_STOPS = ControlWord.STOP | ControlWord.EMERGENCY_STOP
_WRITTEN = (range(r.INPUT_POLARITY.address, 0xE0), range(r.OPERATING_MODE.address, 0x11A))
"""Where its parameters are. What the holes between them do nobody says: MKS "home" is one, the sixth word of a path."""


class TlrAttached(DeviceAdapter):
    """One TL-R drive.

    Args:
        address: 1..247.
        told: told that the drive said, asked by the bus, that it stands.
        interrupted: told when the bus stopped it for safety, or lost it.
    """

    family = FAMILY
    start_grace = 0.1

    def __init__(self, address: int, told: Callable[[], None], interrupted: Callable[[float, str], None]) -> None:
        self.address = address
        self.motion = Motion()
        self.word = ControlWord.NONE
        """What the control word was last set to, as far as is known."""
        self.ramp_takes = _LONGEST_RAMP
        """Seconds that the ramp down takes of what it was told last."""
        self._told = told
        self._interrupted = interrupted
        # All, all but the speed, and the status alone.
        self._reads = (
            read(address, r.TELEMETRY),
            read_holding(address, r.STATUS.address, r.TELEMETRY.count - 1),
            read(address, r.STATUS),
        )

    def reads(self) -> Sequence[Request]:
        return self._reads

    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        # Whether the bits act by their level or by their rising edge is not said. So one that is set already is never
        # taken back, which may end a stop, and yet one rises: the other one.
        held = self.word & _STOPS
        if not held:
            words = [ControlWord.EMERGENCY_STOP if emergency else ControlWord.STOP]
        elif held != _STOPS:
            words = [_STOPS]
        else:
            words = [ControlWord.EMERGENCY_STOP, _STOPS]
        self.word = words[-1]
        return [control(self.address, word) for word in words]

    def stopping_time(self, emergency: bool) -> float:
        if emergency:
            return _EMERGENCY_STOP_TAKES
        # What an input has set in motion has a ramp of its own.
        ramp = self.ramp_takes if self.motion.may_move else _LONGEST_RAMP
        return ramp + _EMERGENCY_STOP_TAKES

    def judgement(self, motion: Motion) -> StandstillDetector:
        return _TlrJudgement(self._reads)

    def hears(self, request: Request) -> bool:
        """Whether it would act on this broadcast. The manual does not say whether it listens: taken for granted."""
        if request.function not in (WRITE_SINGLE, WRITE_MULTIPLE):
            return False
        first, count = request.register, 1
        if request.function == WRITE_MULTIPLE:
            count = int.from_bytes(request.adu[4:6], "big")
        return any(first < written.stop and first + count > written.start for written in _WRITTEN)

    def does_nothing(self, request: Request, code: int) -> bool:
        """04 says that it was denied (4.4), not that it failed."""
        return code == ExceptionCode.EXECUTION_DENIED

    def told(self, request: Request, reply: bytes, sent_at: float) -> None:
        if request in self._reads and not report(payload(reply)).moving:
            self._told()

    def interrupted(self, unheard: float, reason: str) -> None:
        self._interrupted(unheard, reason)


class _TlrJudgement(StandstillDetector):
    """It stands if it says that it does not run, and its speed or its positions say so, too."""

    def __init__(self, reads: Sequence[Request]) -> None:
        self._reads = reads
        self._last: tuple[int, float] | None = None

    def ask(self, free: Callable[[Request], bool]) -> Request | None:
        return next((request for request in self._reads if free(request)), None)

    def see(self, request: Request, reply: bytes, sent_at: float) -> bool | None:
        seen = report(payload(reply))
        if seen.moving:
            return False
        if seen.rpm is not None:
            return True
        if seen.position is None:
            return None
        last, now = self._last, (seen.position, sent_at)
        if last is None or abs(seen.position - last[0]) > _SAME:
            self._last = now
            return None
        return True if sent_at - last[1] >= _STANDS_FOR else None
