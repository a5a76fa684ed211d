"""An MKS drive, as its bus knows it: how it stops, is confirmed, is fed. Source: MKS RTU V1.0.9."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rs485bus.bus.units.adapter import DeviceAdapter, StandstillDetector, WatchdogRegister
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import is_native, read, write
from rs485bus.devices.mks.values import Status
from rs485bus.wire.frames import BROADCAST, READ_INPUT, WRITE_MULTIPLE, WRITE_SINGLE, Request, payload

FAMILY = "MKS"
LATE_REPLY_WINDOW = 0.7
"""Seconds; replies have been seen that late while the motor moves."""
_STANDS_FOR = 0.05
"""Seconds between two equal positions that show a motor standing whose status does not say so."""
_SAME = 2
_URGENT_STOP_TAKES = 0.1
_LONGEST = max(17 + 2 * block.count for block in r.BLOCK_WRITES)
"""Bytes: a write has 9 beside its data, and its reply has 8. Reads take less."""
_WRITTEN = {register.address for register in (*r.SINGLE_WRITES, *r.BLOCK_WRITES)}

_MODBUS_IS_OFF = (
    "Modbus is switched off in it. `enable_modbus` of rs485bus.devices.mks switches it on, and so does MB_RTU in the "
    "menu of the drive."
)

_DISRUPTING = {
    register.address
    for register in (
        r.CALIBRATE,
        r.FACTORY_RESET,
        r.RESTART,
        r.BOOT,
        r.SINGLE_TURN,
        r.ADDRESS,
        r.BAUD_RATE,
        r.MODBUS,
    )
}
"""They restart or silence the drive, take it elsewhere, or (0x9A) keep the pair for 1.6 s."""


class MksWatchdog(WatchdogRegister):
    """Register 0x98 (3.2.14). It cannot be read."""

    register = r.WATCHDOG.address
    count = r.WATCHDOG.count
    highest = 0xFFFF_FFFF

    def __init__(self, address: int) -> None:
        self._address = address

    def write(self, milliseconds: int) -> Request:
        return write(self._address, r.WATCHDOG, milliseconds)


class MksAttached(DeviceAdapter):
    """One MKS drive.

    Args:
        address: 1..247.
        told: told of what the drive says unasked.
        interrupted: told when the bus stopped it for safety.
    """

    family = FAMILY
    longest = _LONGEST
    late_reply_window = LATE_REPLY_WINDOW
    when_silent = f"Or {_MODBUS_IS_OFF}"
    read_function = READ_INPUT  # and no other
    combines_reads = False  # addresses are command codes (MKS RTU V1.0.9, 4)

    def __init__(
        self,
        address: int,
        told: Callable[[Request, bytes], None],
        interrupted: Callable[[float, str], None],
    ) -> None:
        self.address = address
        self.motion = Motion()
        self.watchdog = MksWatchdog(address)
        self.ramp_stop: Request | None = None
        """The stop that belongs to the move under way, with its ramp (8.2, 9.4.2)."""
        self.ramp_takes = 0.0
        """Seconds that it takes."""
        self._told = told
        self._interrupted = interrupted
        self._status = read(address, r.STATUS)
        self._position = read(address, r.POSITION)
        self._reads = (self._status, self._position, read(address, r.PULSES))
        self._emergency_stop = write(address, r.EMERGENCY_STOP, 1)

    def reads(self) -> Sequence[Request]:
        return self._reads

    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        ramp = None if emergency else self.ramp_stop
        return (self._emergency_stop if ramp is None else ramp,)

    def stopping_time(self, emergency: bool) -> float:
        return _URGENT_STOP_TAKES if emergency or self.ramp_stop is None else self.ramp_takes + _URGENT_STOP_TAKES

    def judgement(self, motion: Motion) -> StandstillDetector:
        return _MksJudgement(self._reads)

    def explain(self, heard: bytes) -> str:
        if is_native(self.address, heard):
            return f"It answers in its own protocol ({heard.hex(' ').upper()}): {_MODBUS_IS_OFF}"
        return ""

    def hears(self, request: Request) -> bool:
        return request.function in (WRITE_SINGLE, WRITE_MULTIPLE) and request.register in _WRITTEN

    def disrupts(self, request: Request) -> bool:
        return request.function in (WRITE_SINGLE, WRITE_MULTIPLE) and request.register in _DISRUPTING

    def broadcast_stop(self) -> Request | None:
        return write(BROADCAST, r.EMERGENCY_STOP, 1)

    def told(self, request: Request, reply: bytes, sent_at: float) -> None:
        self._told(request, reply)

    def interrupted(self, unheard: float, reason: str) -> None:
        self._interrupted(unheard, reason)


class _MksJudgement(StandstillDetector):
    """Status first. Where it goes on saying that the motor moves, as some drives do, positions that stay decide."""

    def __init__(self, reads: Sequence[Request]) -> None:
        self._reads = reads
        self._moves = False
        self._last: tuple[Request, bytes, float] | None = None

    def ask(self, free: Callable[[Request], bool]) -> Request | None:
        status, *positions = self._reads
        wanted = [*positions, status] if self._moves else [status, *positions]
        self._moves = not self._moves
        return next((request for request in wanted if free(request)), None)

    def see(self, request: Request, reply: bytes, sent_at: float) -> bool | None:
        if request is self._reads[0]:
            status = int.from_bytes(payload(reply), "big")
            self.by_status_alone = status == Status.STOPPED
            if self.by_status_alone:
                return True
            return None if status == Status.QUERY_FAILED else False
        last = self._last
        if last is None or last[0] is not request:
            self._last = (request, reply, sent_at)
            return None
        if sent_at - last[2] < _STANDS_FOR:
            return None
        self._last = (request, reply, sent_at)
        self.by_status_alone = False
        moved = int.from_bytes(payload(reply), "big") - int.from_bytes(payload(last[1]), "big")
        return True if abs(moved) <= _SAME else None
