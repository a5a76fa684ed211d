"""A virtual MKS SERVO drive. Source: MKS RTU V1.0.9; what the manual leaves open is an option of the drive."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import (
    BaudRate,
    Boot,
    HomingMode,
    Inputs,
    Level,
    Model,
    OutputMask,
    ParameterDirection,
    PowerOnRun,
    SingleTurn,
    Status,
    WorkMode,
    ZeroPoint,
)
from rs485bus.errors import LimitExceeded
from rs485bus.sim.device import SimDevice
from rs485bus.sim.mks_motion import FOREVER, Machine, MksMotion, Refused
from rs485bus.wire.frames import BROADCAST
from rs485bus.wire.registers import Field, Register

_SINGLE: dict[int, Register[Any]] = {register.address: register for register in r.SINGLE_WRITES}
_BLOCKS: dict[tuple[int, int], Any] = {(block.address, block.count): block for block in r.BLOCK_WRITES}
_RESTART_TAKES = 0.6
_CALIBRATION_TAKES = 3.0
_SINGLE_TURN_TAKES = 1.6
_NEW_SETTING_TAKES = 0.02


class SimMks(SimDevice):
    """A drive, its motor, and the machine on its shaft.

    Args:
        address: 1..247.
        model: which drive.
        shaft: where the shaft stands, in turns of the machine.
        machine: what the shaft drives.
        mode: the work mode it is set to.
        microsteps: what it is set to.
        enabled_at_power_on: whether it is energised then (9.4.3 runs without enabling first).
        trip_latches: after its watchdog stopped it, it moves only after an enable.
        fed_by: what feeds its watchdog, of "reads", "writes", "others" (frames to others) and "broadcasts".
        stuck_status: what 0xF1 goes on saying after a move, as some drives do; None for none.
        answers_at_new: a write of address or baud rate is answered at the new setting already.
    """

    def __init__(
        self,
        address: int = 1,
        *,
        model: Model = Model.SERVO42D,
        shaft: float = 0.0,
        machine: Machine | None = None,
        mode: WorkMode = WorkMode.SR_VFOC,
        microsteps: int = 16,
        enabled_at_power_on: bool = True,
        trip_latches: bool = False,
        fed_by: frozenset[str] = frozenset({"reads", "writes"}),
        stuck_status: Status | None = None,
        answers_at_new: bool = False,
    ) -> None:
        super().__init__(address)
        self.model = model
        self.enabled_at_power_on = enabled_at_power_on
        self.trip_latches = trip_latches
        self.fed_by = fed_by
        self.stuck_status = stuck_status
        self.answers_at_new = answers_at_new
        self.version = 0x0109
        self.settings = _factory_settings()
        """What it keeps when it is switched off, by register: a value, or the values of a block."""
        self.settings[r.WORK_MODE.address] = mode
        self.settings[r.MICROSTEPS.address] = microsteps
        self.motion = MksMotion(self.settings, machine or Machine(), shaft)
        self.trips: list[float] = []
        """When its watchdog stopped it."""
        self.restarts = 0
        self._last = 0.0
        self._heard_at = 0.0
        self._ready_at = 0.0
        self._tripped = False
        self._silent = False
        self._outputs = Inputs(0)
        self._commands: dict[int, Callable[[Any, float], None]] = {
            r.RELEASE_STALL.address: lambda _, now: self.motion.release_stall(),
            r.FACTORY_RESET.address: lambda _, now: self._factory_reset(now),
            r.RESTART.address: lambda _, now: self.restart(now),
            r.BOOT.address: self._boot,
            r.CALIBRATE.address: lambda _, now: self._calibrate(now),
            r.WORK_MODE.address: self._set_mode,
            r.CURRENT.address: lambda value, now: self._set_current(value),
            r.BAUD_RATE.address: self._set_baud_rate,
            r.ADDRESS.address: self._set_address,
            r.GO_HOME.address: self._moves(self.motion.go_home),
            r.SET_ZERO.address: lambda _, now: self.motion.set_zero(now),
            r.ENABLE.address: self._enable,
            r.EMERGENCY_STOP.address: lambda _, now: self.motion.stop(FOREVER, now),
            r.POWER_ON_RUN.address: self._power_on_run,
        }
        self._moving_blocks: dict[Any, Callable[[tuple[Any, ...], float], None]] = {
            r.RUN: self._moves(self.motion.run),
            r.RUN_FOR: self._moves(self.motion.run),
            r.MOVE_PULSES: self._moves(self.motion.move_pulses),
            r.MOVE_COUNTS: self._moves(self.motion.move_counts),
            r.MOVE_TO_PULSES: self._moves(self.motion.move_to_pulses),
            r.MOVE_TO_COUNTS: self._moves(self.motion.move_to_counts),
        }
        self.motion.reset(0.0, enabled_at_power_on)

    # What one sees of it

    @property
    def watchdog_ms(self) -> int:
        """The time its watchdog is set to, in ms; 0 for off."""
        return int(self.settings[r.WATCHDOG.address])

    @property
    def moves(self) -> int:
        """How often it was set in motion."""
        return self.motion.moves

    def shaft(self, now: float) -> float:
        """Where its shaft is, in turns of the machine."""
        self.advance(now)
        return self.motion.motor.position(now)

    def moving(self, now: float) -> bool:
        """Whether its shaft turns."""
        self.advance(now)
        return self.motion.motor.moving(now)

    def status(self, now: float) -> Status:
        """What 0xF1 reads."""
        status = self.motion.status(now)
        stuck = self.stuck_status is not None and self.motion.has_moved and status is Status.STOPPED
        return self.stuck_status if stuck and self.stuck_status is not None else status

    # What happens to it

    def advance(self, now: float) -> None:
        """Let everything happen until now, each at its time."""
        starves_at = self._heard_at + self.watchdog_ms / 1000 if self.watchdog_ms else FOREVER
        self.motion.advance(self._last, now, starves_at, self._trip)
        self._last = now

    def restart(self, now: float) -> None:
        """Start anew, as after a power cycle: settings stay, the rest is forgotten, counting begins at zero."""
        self.motion.reset(now, self.enabled_at_power_on)
        self.restarts += 1
        self._tripped = self._silent = False
        self._outputs = Inputs(0)
        self._ready_at = now + _RESTART_TAKES
        self.motion.later(_RESTART_TAKES, now, self._power_on)

    def _power_on(self, now: float) -> None:
        self._heard_at = now
        run = self.settings[r.POWER_ON_RUN.address]
        if run is not None:
            self.motion.run(run, now)
        elif self.settings[r.SINGLE_TURN.address][0] is not SingleTurn.OFF:
            self.motion.home_in_turn(now)

    def _trip(self, now: float) -> None:
        self.trips.append(now)
        self.motion.stop(FOREVER, now)
        self._tripped = True

    # The wire

    def receive(self, frame: bytes, now: float) -> bytes | None:
        self.advance(now)
        others = frame[:1] not in (bytes([BROADCAST]), bytes([self.address]))
        if (others and "others" in self.fed_by) or (frame[:1] == b"\0" and "broadcasts" in self.fed_by):
            self._heard_at = now
        return super().receive(frame, now)

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        address = int.from_bytes(pdu[1:3], "big")
        silent = self._silent and address != r.BOOT.address
        if now < self._ready_at or silent or not self.settings[r.MODBUS.address]:
            return None
        if not broadcast and ("reads" if pdu[0] == 4 else "writes") in self.fed_by:
            self._heard_at = now
        self.turnaround = None
        if pdu[0] == 4 and len(pdu) == 5:
            return self._read(address, int.from_bytes(pdu[3:5], "big"), now)
        try:
            if pdu[0] == 6 and len(pdu) == 5:
                self._write_single(address, pdu[3:], now)
                return pdu
            if pdu[0] == 16 and len(pdu) > 6:
                self._write_block(address, int.from_bytes(pdu[3:5], "big"), pdu[6:], now)
                return pdu[:5]
        except Refused:
            return pdu[:3] + (b"\xff\xff" if pdu[0] == 6 else b"\0\0")
        return None  # the manual describes no exception reply

    def _read(self, address: int, count: int, now: float) -> bytes | None:
        motion = self.motion
        turns, part = divmod(motion.motor.position(now), 1.0)
        values: dict[tuple[int, int], bytes] = {
            (r.ENCODER.address, 3): r.ENCODER.encode(int(turns), int(part * r.COUNTS_PER_TURN)),
            (r.POSITION.address, 3): r.POSITION.encode(motion.counts(now)),
            (r.SPEED.address, 1): r.SPEED.encode(round(motion.motor.rpm(now))),
            (r.PULSES.address, 2): r.PULSES.encode(motion.pulses(now) % 0x1_0000_0000),
            (r.INPUTS.address, 1): r.INPUTS.encode(motion.inputs(now) | self._outputs),
            (r.ANGLE_ERROR.address, 2): r.ANGLE_ERROR.encode(motion.machine.following_error),
            (r.ENABLED.address, 1): r.ENABLED.encode(motion.enabled),
            (r.HOMED.address, 1): r.HOMED.encode(*motion.homed),
            (r.STALLED.address, 1): r.STALLED.encode(motion.stalled),
            (r.VERSION.address, 2): r.VERSION.encode(self.version),
            (r.STATUS.address, 1): r.STATUS.encode(self.status(now)),
        }
        data = values.get((address, count))
        return None if data is None else bytes((4, len(data))) + data

    def _write_single(self, address: int, data: bytes, now: float) -> None:
        register = _SINGLE.get(address)
        if register is None:
            raise Refused
        value = int.from_bytes(data, "big") if register is r.CURRENT else _decoded((register,), data)[0]
        command = self._commands.get(address)
        if command is not None:
            command(value, now)
        else:
            self.settings[address] = value

    def _write_block(self, address: int, count: int, data: bytes, now: float) -> None:
        block = _BLOCKS.get((address, count))
        if block is None:
            raise Refused
        if isinstance(block, Register):
            self.settings[address] = _decoded((block,), data)[0]
            return
        values = _decoded(block.fields, data)
        if (move := self._moving_blocks.get(block)) is not None:
            move(values, now)
        elif block is r.OUTPUTS:
            self._write_outputs(*values)
        elif block is r.PULSE_DIVIDER and not self.model.has_outputs:
            raise Refused
        else:
            self.settings[address] = values
            if block is r.SINGLE_TURN:
                self._set_turn_zero(values[1], now)

    # Commands

    def _moves(self, command: Callable[[Any, float], None]) -> Callable[[Any, float], None]:
        """A command that moves the motor, refused after a trip that latches."""

        def run(values: Any, now: float) -> None:
            if self._tripped and self.trip_latches:
                raise Refused
            command(values, now)

        return run

    def _enable(self, on: bool, now: float) -> None:
        self.motion.enable(on, now)
        self._tripped = False

    def _set_mode(self, mode: WorkMode, now: float) -> None:
        if mode is not self.motion.mode:
            self.motion.stop(FOREVER, now)
        self.settings[r.WORK_MODE.address] = mode

    def _set_current(self, value: int) -> None:
        current = value & ~r.CURRENT_NOT_SAVED
        if current > self.model.max_current:
            raise Refused
        self.motion.current = current
        if current == value:
            self.settings[r.CURRENT.address] = current

    def _set_turn_zero(self, zero: ZeroPoint, now: float) -> None:
        if zero is not ZeroPoint.KEEP:
            self.motion.turn_zero = self.motion.motor.position(now) % 1.0 if zero is ZeroPoint.SET_HERE else 0.0
        self.turnaround = _SINGLE_TURN_TAKES

    def _power_on_run(self, flag: PowerOnRun, now: float) -> None:
        save = flag is PowerOnRun.SAVE
        self.settings[r.POWER_ON_RUN.address] = self.motion.last_run if save else None
        if save:
            self.motion.stop(1000.0, now)  # 8.5: the motor slows down and stops

    def _set_baud_rate(self, code: BaudRate, now: float) -> None:
        self.settings[r.BAUD_RATE.address] = code
        self._change("baudrate", code.baudrate, now)

    def _set_address(self, address: int, now: float) -> None:
        self.settings[r.ADDRESS.address] = address
        self._change("address", address, now)

    def _change(self, name: str, value: int, now: float) -> None:
        if self.answers_at_new:
            setattr(self, name, value)
        else:
            self.motion.later(_NEW_SETTING_TAKES, now, lambda _: setattr(self, name, value))

    def _boot(self, what: Boot, now: float) -> None:
        self._silent = what is Boot.ENTER_SILENCE
        if what is Boot.ENTER_BOOT:
            self.motion.stop(FOREVER, now)
            self._ready_at = FOREVER

    def _calibrate(self, now: float) -> None:
        self.motion.stop(FOREVER, now)
        self.motion.activity = Status.CALIBRATING
        self.motion.later(_CALIBRATION_TAKES, now, self.restart)

    def _factory_reset(self, now: float) -> None:
        self.settings.update({**_factory_settings(), r.ADDRESS.address: self.address})
        self.restart(now)

    def _write_outputs(self, mask_2: OutputMask, on_2: bool, mask_1: OutputMask, on_1: bool) -> None:
        if not self.model.has_outputs:
            raise Refused
        for mask, on, port in ((mask_2, on_2, Inputs.OUT_2), (mask_1, on_1, Inputs.OUT_1)):
            if mask is OutputMask.WRITE:
                self._outputs = self._outputs | port if on else self._outputs & ~port


def _factory_settings() -> dict[int, Any]:
    return {
        r.WORK_MODE.address: WorkMode.CR_VFOC,
        r.CURRENT.address: 1600,
        r.MICROSTEPS.address: 16,
        r.STALL_PROTECTION.address: False,
        r.BAUD_RATE.address: BaudRate.BAUD_38400,
        r.MODBUS.address: True,
        r.WATCHDOG.address: 0,
        r.POWER_ON_RUN.address: None,
        r.HOMING.address: (Level.LOW, ParameterDirection.CW, 60, False),
        r.HOMING_TORQUE.address: (0x2000, HomingMode.SWITCH, 400),
        r.SINGLE_TURN.address: (SingleTurn.OFF, ZeroPoint.KEEP, 2, ParameterDirection.CW),
    }


def _decoded(fields: tuple[Field[Any], ...], data: bytes) -> tuple[Any, ...]:
    """Typed values, or a refusal where a value or the length is wrong."""
    if sum(field.number.size for field in fields) != len(data):
        raise Refused
    values, at = [], 0
    for field in fields:
        try:
            value = field.decode(data[at:])
            field.raw(value)
        except (ValueError, LimitExceeded):
            raise Refused from None
        values.append(value)
        at += field.number.size
    return tuple(values)
