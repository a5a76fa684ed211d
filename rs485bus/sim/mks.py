"""A virtual MKS SERVO drive. Source: MKS RTU V1.0.9; what the manual leaves open is an option of the drive."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import native, understand
from rs485bus.devices.mks.values import (
    BaudRate,
    Boot,
    Inputs,
    Level,
    Model,
    OutputMask,
    PowerOnRun,
    SingleTurn,
    Status,
    WorkMode,
    ZeroPoint,
)
from rs485bus.sim.device import SimDevice
from rs485bus.sim.mks_machine import Machine
from rs485bus.sim.mks_memory import Refused, accept, factory_settings
from rs485bus.sim.mks_motion import MksMotion
from rs485bus.sim.mks_quirks import PLAIN, Manners, Quirks
from rs485bus.sim.mks_readings import readings
from rs485bus.sim.mks_shaft import FOREVER
from rs485bus.wire.frames import BROADCAST, READ_INPUT, WRITE_SINGLE, crc

_CALIBRATION_TAKES = 3.0
_SINGLE_TURN_TAKES = 1.6
_NEW_SETTING_TAKES = 0.02
_POWER_ON_STOP_RAMP = 1000.0
_SHORTEST_DIVISION = 100
"""Pulses to a toggle of OUT_2 below which there is no output (4.3)."""
_NATIVE_REPLY = 0xFB


class SimMks(SimDevice):
    """A drive, its motor, and the machine on its shaft.

    Args:
        address: 1..247.
        model: which drive. Only the 57D has IN_2, OUT_1 and OUT_2; it takes up to 5200 mA, the others 3000.
        shaft: where the shaft stands, in turns of the machine.
        machine: what the shaft drives.
        mode: the work mode it is set to.
        microsteps: what it is set to.
        baudrate: what it is set to, in bit/s; None for whatever the line is.
        enabled_at_power_on: whether it is energised then (9.4.3 runs without enabling first).
        trip_latches: after its watchdog stopped it, it moves only after an enable.
        watchdog_kept: it keeps its watchdog (3.2.14) when it is switched off, and has it off after that otherwise.
        fed_by: what feeds its watchdog, of "reads", "writes", "others" (frames to others) and "broadcasts".
        stuck_status: what 0xF1 goes on saying after a move, as some drives do; None for none.
        quirks: what else it does beside its manual.
        answers_at_new: a write of address, baud rate or protocol is answered at the new setting already.
        reset_keeps_line: a factory reset leaves address and baud rate as they are.
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
        baudrate: int | None = None,
        enabled_at_power_on: bool = True,
        trip_latches: bool = False,
        watchdog_kept: bool = True,
        fed_by: frozenset[str] = frozenset({"reads", "writes"}),
        stuck_status: Status | None = None,
        quirks: Quirks = PLAIN,
        answers_at_new: bool = False,
        reset_keeps_line: bool = True,
    ) -> None:
        super().__init__(address)
        self.model = model
        self.baudrate = baudrate
        self.enabled_at_power_on = enabled_at_power_on
        self.trip_latches = trip_latches
        self.watchdog_kept = watchdog_kept
        self.restart_takes = 0.6
        """Seconds in which it then answers nothing."""
        self.fed_by = fed_by
        self._manners = Manners(quirks, stuck_status)
        self.answers_at_new = answers_at_new
        self.reset_keeps_line = reset_keeps_line
        self.version = 0x0109
        self.settings = factory_settings()
        """What it keeps when it is switched off, by register: a value, or the values of a block."""
        self.settings[r.WORK_MODE.address] = mode
        self.settings[r.MICROSTEPS.address] = microsteps
        self.motion = MksMotion(self.settings, model, machine or Machine(), shaft)
        self.trips: list[float] = []
        """When its watchdog stopped it."""
        self.restarts = 0
        self._last = self._heard_at = self._ready_at = 0.0
        self._tripped = False
        self._silent = False
        self._outputs: dict[Inputs, bool] = {}
        self._commands: dict[int, Callable[[Any, float], None]] = {
            r.RELEASE_STALL.address: lambda _, now: self.motion.release_stall(),
            r.FACTORY_RESET.address: lambda _, now: self._factory_reset(now),
            r.RESTART.address: lambda _, now: self._start_anew(now),
            r.BOOT.address: self._boot,
            r.CALIBRATE.address: lambda _, now: self._calibrate(now),
            r.WORK_MODE.address: self._set_mode,
            r.CURRENT.address: lambda value, now: self._set_current(value),
            r.BAUD_RATE.address: self._set_baud_rate,
            r.ADDRESS.address: lambda value, now: self._change("address", value, now),
            r.GO_HOME.address: self._moves(self.motion.go_home),
            r.SET_ZERO.address: lambda _, now: self.motion.set_zero(now),
            r.ENABLE.address: self._enable,
            r.EMERGENCY_STOP.address: lambda _, now: self.motion.stop(FOREVER, now),
            r.POWER_ON_RUN.address: self._power_on_run,
        }
        self._blocks: dict[int, Callable[[tuple[Any, ...], float], None]] = {
            r.RUN.address: self._moves(self.motion.run),
            r.MOVE_PULSES.address: self._moves(self.motion.move_pulses),
            r.MOVE_COUNTS.address: self._moves(self.motion.move_counts),
            r.MOVE_TO_PULSES.address: self._moves(self.motion.move_to_pulses),
            r.MOVE_TO_COUNTS.address: self._moves(self.motion.move_to_counts),
            r.OUTPUTS.address: lambda values, now: self._write_outputs(*values),
            r.HOMING_TORQUE.address: lambda values, now: self._set_homing_torque(values),
            r.PULSE_DIVIDER.address: lambda values, now: self._set_divider(values),
            r.SINGLE_TURN.address: self._set_single_turn,
        }
        self._readings = readings(self)
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
        return self._manners.status(self.motion, now)

    def inputs(self, now: float) -> Inputs:
        """What 0x34 reads. OUT_1 shows a stall, OUT_2 the pulse divider, unless they were written (1.2, 4.2, 4.3)."""
        inputs = self.motion.inputs(now)
        if not self.model.has_outputs:
            return inputs
        level, period = self.settings[r.PULSE_DIVIDER.address]
        toggled = self.motion.pulses(now) // period % 2 == 1 if period >= _SHORTEST_DIVISION else False
        shown = {Inputs.OUT_1: not self.motion.protected, Inputs.OUT_2: toggled != (level is Level.HIGH)}
        for port, on in {**shown, **self._outputs}.items():
            inputs |= port if on else Inputs(0)
        return inputs

    # What happens to it

    def advance(self, now: float) -> None:
        """Let everything happen until now, each at its time."""
        starves_at = self._heard_at + self.watchdog_ms / 1000 if self.watchdog_ms else FOREVER
        self.motion.advance(self._last, now, starves_at, self.trip)
        self._last = now

    def restart(self, now: float) -> None:
        """Start anew, as after a power cycle: settings stay, the rest is forgotten, counting begins at zero."""
        self.advance(now)
        self._start_anew(now)

    def switch_off(self, now: float) -> None:
        """Take its power: the motor stands, and nobody answers."""
        self.advance(now)
        self.motion.reset(now, enabled=False)
        self._ready_at = FOREVER

    def switch_on(self, now: float) -> None:
        """Give it power again: it answers after a moment, with its settings kept."""
        self.advance(now)
        self._start_anew(now)

    def _start_anew(self, now: float) -> None:
        self.motion.reset(now, self.enabled_at_power_on)
        self.restarts += 1
        self._tripped = self._silent = False
        self._outputs.clear()
        if not self.watchdog_kept:
            self.settings[r.WATCHDOG.address] = 0
        self._ready_at = now + self.restart_takes
        self.motion.later(self.restart_takes, now, self._power_on)

    def turn_shaft(self, turns: float, now: float) -> None:
        """Turn the shaft of a standing motor by hand."""
        self.advance(now)
        self.motion.motor.place(self.motion.motor.position(now) + turns, now)

    def put_load(self, load: int, now: float) -> None:
        """The machine takes so much current, in mA, to move from now on."""
        self.advance(now)
        self.motion.put_load(load, now)

    def _power_on(self, now: float) -> None:
        self._heard_at = now
        run = self.settings[r.POWER_ON_RUN.address]
        if run is not None:
            self.motion.run(run, now)
        elif self.settings[r.SINGLE_TURN.address][0] is not SingleTurn.OFF:
            self.motion.home_in_turn(now)

    def trip(self, now: float) -> None:
        """Its watchdog stops it."""
        self.trips.append(now)
        self.motion.stop(FOREVER, now)
        self._tripped = True

    # The wire

    def heeds(self, frame: bytes) -> bool:
        mine = frame[0] in (self.address, BROADCAST) or not self.settings[r.MODBUS.address]
        return mine or "others" in self.fed_by or self.motion.planned  # another address, perhaps

    def rate(self, now: float) -> int | None:
        self.advance(now)
        return self.baudrate

    def receive(self, frame: bytes, now: float) -> bytes | None:
        self.advance(now)
        others = frame[:1] not in (bytes([BROADCAST]), bytes([self.address]))
        if (others and "others" in self.fed_by) or (frame[:1] == b"\0" and "broadcasts" in self.fed_by):
            self._heard_at = now
        if not self.settings[r.MODBUS.address]:
            return self._receive_native(frame, now)
        address = self.address
        reply = super().receive(frame, now)
        if reply is None or not self.answers_at_new:
            return reply
        if not self.settings[r.MODBUS.address]:
            return self._native_reply(r.MODBUS.address)
        if self.address != address:
            body = bytes([self.address]) + reply[1:-2]
            return body + crc(body)
        return reply

    def _receive_native(self, frame: bytes, now: float) -> bytes | None:
        """With Modbus off, the one frame of the native protocol that the manual names (3.2.12)."""
        if now < self._ready_at or frame != native(self.address, r.MODBUS.address, 1).adu:
            return None
        self.settings[r.MODBUS.address] = True
        return None if self.answers_at_new else self._native_reply(r.MODBUS.address)

    def _native_reply(self, code: int) -> bytes:
        # The manual prints none; the family's native protocol answers like this.
        body = bytes((_NATIVE_REPLY, self.address, code, 1))
        return body + bytes([sum(body) % 256])

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        silent = self._silent and int.from_bytes(pdu[1:3], "big") != r.BOOT.address
        if now < self._ready_at or silent:
            return None
        if not broadcast and ("reads" if pdu[0] == READ_INPUT else "writes") in self.fed_by:
            self._heard_at = now
        self.turnaround = None
        if pdu[0] not in (4, 6, 16):
            return None  # the manual describes no exception reply
        if pdu[0] == READ_INPUT:
            return self._read(pdu, now)
        try:
            self._write(pdu, now)
        except Refused:
            return pdu[:3] + (b"\xff\xff" if pdu[0] == WRITE_SINGLE else b"\0\0")
        return pdu[:5]

    def _read(self, pdu: bytes, now: float) -> bytes | None:
        try:
            register = understand(pdu).what.address
        except ValueError:
            return None
        data = self._manners.answered(register, self._readings[register](now))
        return bytes((READ_INPUT, len(data))) + data

    def _write(self, pdu: bytes, now: float) -> None:
        self._manners.refuse()
        spoken = accept(pdu)
        register, values = spoken.what.address, spoken.values
        if (block := self._blocks.get(register)) is not None:
            block(values, now)
        elif (command := self._commands.get(register)) is not None:
            command(values[0], now)
        else:
            self.settings[register] = values[0] if len(values) == 1 else values

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

    def _set_homing_torque(self, values: tuple[Any, ...]) -> None:
        if values[2] > self.model.max_current:
            raise Refused
        self.settings[r.HOMING_TORQUE.address] = values

    def _set_single_turn(self, values: tuple[Any, ...], now: float) -> None:
        self.settings[r.SINGLE_TURN.address] = values
        zero = values[1]
        if zero is not ZeroPoint.KEEP:
            here = self.motion.motor.position(now) % 1.0
            self.motion.turn_zero = here if zero is ZeroPoint.SET_HERE else None
        self.turnaround = _SINGLE_TURN_TAKES

    def _set_divider(self, values: tuple[Any, ...]) -> None:
        if not self.model.has_outputs:
            raise Refused
        self.settings[r.PULSE_DIVIDER.address] = values

    def _write_outputs(self, mask_2: OutputMask, on_2: bool, mask_1: OutputMask, on_1: bool) -> None:
        if not self.model.has_outputs:
            raise Refused
        for mask, on, port in ((mask_2, on_2, Inputs.OUT_2), (mask_1, on_1, Inputs.OUT_1)):
            if mask is OutputMask.WRITE:
                self._outputs[port] = on

    def _power_on_run(self, flag: PowerOnRun, now: float) -> None:
        save = flag is PowerOnRun.SAVE
        self.settings[r.POWER_ON_RUN.address] = self.motion.last_run if save else None
        if save:
            self.motion.stop(_POWER_ON_STOP_RAMP, now)  # 8.5: the motor slows down and stops

    def _set_baud_rate(self, code: BaudRate, now: float) -> None:
        self.settings[r.BAUD_RATE.address] = code
        self._change("baudrate", code.baudrate, now)

    def _change(self, name: str, value: int, now: float) -> None:
        if self.answers_at_new:
            setattr(self, name, value)
        else:
            self.motion.later(_NEW_SETTING_TAKES, now, lambda _: setattr(self, name, value))

    def _boot(self, what: Boot, now: float) -> None:
        self._silent = what is Boot.ENTER_SILENCE
        if what is Boot.ENTER_BOOT:
            self.switch_off(now)  # it waits for firmware until it is switched off and on

    def _calibrate(self, now: float) -> None:
        self.motion.stop(FOREVER, now)
        self.motion.activity = Status.CALIBRATING
        self.motion.later(_CALIBRATION_TAKES, now, self._start_anew)

    def _factory_reset(self, now: float) -> None:
        self.settings.update(factory_settings())
        if not self.reset_keeps_line:
            self.address, self.baudrate = 1, BaudRate.BAUD_38400.baudrate
        self._start_anew(now)
