"""A ZLAC8015D, as its bus knows it: how it stops, is confirmed, is fed. Source: ZLAC8015D RS485 V1.06.

Both wheels share one address, one control word, one mode and one watchdog. So a wheel can be stopped alone in velocity
mode only, by its target; everything else stops both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rs485bus.bus.units.adapter import DeviceAdapter, StandstillDetector, WatchdogRegister
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.frames import control, read, write, write_twins
from rs485bus.devices.zlac.telemetry import StatusWord, Stillness, motions, snapshot
from rs485bus.devices.zlac.values import ControlMode, ControlWord, Side
from rs485bus.wire.frames import WRITE_MULTIPLE, WRITE_SINGLE, Request, payload

FAMILY = "ZLAC"
_QUIET, _CONTRADICTED = 0.04, 0.2
_LONGEST = max(13 + 2 * block.count for side in Side for block in (*r.PARAMETER_BLOCKS[side], r.CONTROL_BLOCK))
"""Bytes: a read has 8, and its reply has 5 beside its data. Writes take less."""
_STOP_TAKES = 0.5
"""Seconds that a quick stop may take; its ramp is 10 ms as shipped."""


class ZlacWatchdog(WatchdogRegister):
    """Register 0x2000, of both wheels. 1000 ms according to the manual; drives have been shipped with 0, which is off.

    The drive keeps what is written to it when it is switched off.
    """

    register = r.WATCHDOG.address
    highest = 0x7FFF

    def __init__(self, address: int) -> None:
        self._address = address

    def write(self, milliseconds: int) -> Request:
        return write(self._address, r.WATCHDOG, milliseconds)

    def read(self) -> Request:
        return read(self._address, r.WATCHDOG)

    def decode(self, reply: bytes) -> int:
        return r.WATCHDOG.decode(payload(reply))


class ZlacAttached(DeviceAdapter):
    """One drive and its two wheels.

    Args:
        address: 1..127.
        smooth_stop: a controlled stop out of position or torque mode is a change to velocity mode with target 0, with
            the ramp, instead of an emergency stop.
        told: told of the status words that the bus reads.
        interrupted: told when the bus stopped it for safety.
        quick_stopped: told that control word 0x05 goes out: the drive is enabled no more. True if somebody meant it
            as an emergency stop.
    """

    family = FAMILY
    longest = _LONGEST
    start_grace = 0.1

    def __init__(
        self,
        address: int,
        *,
        smooth_stop: bool,
        told: Callable[[StatusWord], None],
        interrupted: Callable[[float, str], None],
        quick_stopped: Callable[[bool], None],
    ) -> None:
        self.address = address
        self.sides = {Side.LEFT: Motion(), Side.RIGHT: Motion()}
        self.motion = Motion(self.sides.values())
        self.watchdog = ZlacWatchdog(address)
        self.mode: ControlMode | None = None
        """What it is in; None if that is not known."""
        self.ramp_takes = 0.0
        """Seconds that the ramp down takes."""
        self._smooth_stop = smooth_stop
        self._told = told
        self._interrupted = interrupted
        self._quick_stopped = quick_stopped
        self._status = read(address, r.STATUS)
        self._reads = (self._status, read(address, r.STATE), read(address, r.MOTION))

    def reads(self) -> Sequence[Request]:
        return self._reads

    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        if emergency:
            return self._quick_stop(emergency=True)
        stand = self._stand(motion)
        if self.mode is ControlMode.VELOCITY:
            return (stand,)
        if self.mode is not None and not self.motion.may_move:
            # It was seen standing, and target velocities do nothing now: to be confirmed without letting go of it.
            return (stand,)
        if self._smooth_stop and self.mode is not None:
            self.mode = ControlMode.VELOCITY
            return (self._stand(self.motion), write(self.address, r.MODE, ControlMode.VELOCITY))
        return self._quick_stop(emergency=False)

    def stopping_time(self, emergency: bool) -> float:
        return _STOP_TAKES if emergency else self.ramp_takes + _STOP_TAKES

    def judgement(self, motion: Motion) -> StandstillDetector:
        sides = [side for side, part in self.sides.items() if motion in (part, self.motion)]
        return _ZlacJudgement(self._reads[1:], sides)

    def hears(self, request: Request) -> bool:
        """Whether it would act on this broadcast. The manual is silent: taken for granted for what it has registers
        for, and for functions that are not known. Nothing else could do anything to it if it did listen."""
        if request.function not in (WRITE_SINGLE, WRITE_MULTIPLE):
            return request.writes
        count = 1 if request.function == WRITE_SINGLE else int.from_bytes(request.adu[4:6], "big")
        return request.register <= r.LAST and request.register + count > r.FIRST

    def on_reply(self, request: Request, reply: bytes, asked_at: float, now: float) -> None:
        if request is self._status:
            self._told(StatusWord(r.STATUS.decode(payload(reply))))

    def interrupted(self, unheard: float, reason: str) -> None:
        self._interrupted(unheard, reason)

    def _stand(self, motion: Motion) -> Request:
        for side, part in self.sides.items():
            if motion is part:
                return write(self.address, r.TARGET_VELOCITY.of(side), 0)
        return write_twins(self.address, (r.TARGET_VELOCITY, 0, 0))

    def _quick_stop(self, emergency: bool) -> tuple[Request]:
        # The wheel that was not meant is stopped as well, and nothing older may set it in motion again.
        self.motion.stop()
        self._quick_stopped(emergency)
        return (control(self.address, ControlWord.EMERGENCY_STOP),)


class _ZlacJudgement(StandstillDetector):
    """The positions decide, over a moment; longer where the status word says that a wheel runs."""

    def __init__(self, reads: Sequence[Request], sides: Sequence[Side]) -> None:
        self._reads = reads
        self._watched = {side: Stillness(_QUIET, _CONTRADICTED) for side in sides}

    def ask(self, free: Callable[[Request], bool]) -> Request | None:
        return next((request for request in self._reads if free(request)), None)

    def see(self, request: Request, reply: bytes, sent_at: float) -> bool | None:
        data = payload(reply)
        if request is self._reads[0]:
            seen = snapshot(data, sent_at)
            wheels, running = seen.motion, seen.status.running
        else:
            wheels, running = motions(data), True  # nothing contradicts that it runs
        verdicts = [still.see(sent_at, wheels[side.index], running) for side, still in self._watched.items()]
        if False in verdicts:
            return False
        return None if None in verdicts else True
