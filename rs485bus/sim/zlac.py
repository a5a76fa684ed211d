"""A virtual ZLAC8015D. Source: ZLAC8015D RS485 V1.06; what the manual leaves open is an option of the drive."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import (
    BaudRate,
    ControlMode,
    ControlWord,
    EmergencyShaft,
    Fault,
    InputFunction,
    Inputs,
    Outputs,
    PowerOnShaft,
    ShaftState,
    Side,
    Synchrony,
)
from rs485bus.errors import LimitExceeded
from rs485bus.sim.device import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, Refusal, SimDevice
from rs485bus.sim.zlac_motion import SimWheel
from rs485bus.wire.registers import Register

T = TypeVar("T")

_HELD = (ShaftState.LOCKED,)


class SimZlac(SimDevice):
    """A drive and its two wheels.

    Args:
        address: 1..127.
        counts: what its counters begin with, left and right.
        lines: the encoder lines of both motors.
        watchdog: 0x2000, in ms; some are shipped with 0, which is off.
        status_word_left: which half of the status word is the left wheel's.
        ramp_rpm: the change of speed, in rpm, that takes a ramp time; None for any change.
        enable_resumes: enabling it goes on with the position that an emergency stop interrupted.
        mode_change_releases: it must be enabled again after a change of mode.
        rpm_in_position_mode: it reports speeds in position mode, too.
        trip_state: what its wheels are after its watchdog stopped them.
        following_error: counts by which a wheel stands off its target.
        status_lag: seconds before a wheel stands in which the status says already that it does.
    """

    def __init__(
        self,
        address: int = 1,
        *,
        counts: tuple[int, int] = (0, 0),
        lines: int = 1024,
        watchdog: int = 1000,
        status_word_left: Literal["low", "high"] = "low",
        ramp_rpm: float | None = None,
        enable_resumes: bool = True,
        mode_change_releases: bool = False,
        rpm_in_position_mode: bool = True,
        trip_state: ShaftState = ShaftState.EMERGENCY_STOP,
        following_error: int = 0,
        status_lag: float = 0.0,
    ) -> None:
        super().__init__(r.NODE_ID.raw(address))
        self.status_word_left = status_word_left
        self.mode_change_releases = mode_change_releases
        self.rpm_in_position_mode = rpm_in_position_mode
        self.trip_state = trip_state
        self.status_lag = status_lag
        self.version = 0x0106
        self.bus_voltage = 36.0
        self.temperature = 35.5
        self.pressed = Inputs(0)
        """The inputs that are active."""
        self.trips: list[float] = []
        """When its watchdog stopped it."""
        self.restarts = 0
        self.restart_takes = 1.0
        """Seconds for which it does not answer when it is switched on."""
        self.eeprom: dict[int, int] = {}
        """What it keeps when it is switched off, by address."""
        self.eeprom_writes = 0
        self._words: dict[int, int] = _defaults()
        self._last = self._heard_at = self._ready_at = 0.0
        for register, value in (
            (r.NODE_ID, address),
            (r.WATCHDOG, watchdog),
            (r.ENCODER_LINES.left, lines),
            (r.ENCODER_LINES.right, lines),
        ):
            self.eeprom[register.address] = self._words[register.address] = register.raw(value)
        self.left, self.right = self.wheels = tuple(
            SimWheel(side, self.value, counts[side.index], ramp_rpm, enable_resumes, following_error) for side in Side
        )
        self._commands: dict[int, Callable[[Any, float], None]] = {
            r.CLEAR_POSITION.address: lambda which, now: self._each(which, SimWheel.clear_position, now),
            r.RESET_ZERO.address: lambda which, now: self._each(which, SimWheel.reset_zero, now),
            r.RESTORE.address: self._restore,
            r.MODE.address: self._change_mode,
            r.CONTROL.address: self._control,
            r.TARGET_VELOCITY.left.address: lambda _, now: self._target(self.left, ControlMode.VELOCITY, now),
            r.TARGET_VELOCITY.right.address: lambda _, now: self._target(self.right, ControlMode.VELOCITY, now),
            r.TARGET_TORQUE.left.address: lambda _, now: self._target(self.left, ControlMode.TORQUE, now),
            r.TARGET_TORQUE.right.address: lambda _, now: self._target(self.right, ControlMode.TORQUE, now),
        }

    # What one sees of it

    @property
    def mode(self) -> ControlMode:
        """What it is set to: position, velocity or torque."""
        return self.value(r.MODE)

    @property
    def watchdog_ms(self) -> int:
        """The time its watchdog is set to, in ms; 0 for off."""
        return self.value(r.WATCHDOG)

    @property
    def moves(self) -> tuple[int, int]:
        """How often a start word set each wheel in motion."""
        return self.left.moves, self.right.moves

    def value(self, register: Register[T]) -> T:
        """What a register that can be written holds."""
        words = range(register.address, register.address + register.count)
        return register.decode(b"".join(self._words[address].to_bytes(2, "big") for address in words))

    def shafts(self, now: float) -> tuple[float, float]:
        """Where its wheels are, in turns."""
        self.advance(now)
        return self.left.motor.position(now), self.right.motor.position(now)

    def rpm(self, now: float) -> tuple[float, float]:
        """How fast its wheels turn."""
        self.advance(now)
        return self.left.motor.rpm(now), self.right.motor.rpm(now)

    # What happens to it

    def advance(self, now: float) -> None:
        """Let everything happen until now."""
        trips_at = self._heard_at + self.watchdog_ms / 1000
        if self.watchdog_ms and trips_at <= now and any(wheel.state in _HELD for wheel in self.wheels):
            self._trip(trips_at, max(trips_at, self._last))
        self._last = now

    def trip(self, now: float) -> None:
        """Its watchdog stops it."""
        self.advance(now)
        self._trip(now, now)

    def _trip(self, since: float, now: float) -> None:
        self.trips.append(since)
        self._each(3, lambda wheel, now: wheel.quick_stop(self.trip_state, now), now)

    def fail(self, side: Side, fault: Fault, now: float) -> None:
        """A wheel reports an error. The other one goes on."""
        self.advance(now)
        self.wheels[side.index].fail(fault, now)

    def press(self, inputs: Inputs, now: float) -> None:
        """Make inputs active, and all others inactive."""
        self.advance(now)
        self.pressed = inputs
        if self._emergency_input:
            locks = self.value(r.EMERGENCY_SHAFT) is EmergencyShaft.LOCK
            self._each(3, lambda wheel, now: wheel.quick_stop(ShaftState.EMERGENCY_STOP, now), now)
            if not locks:
                self._each(3, SimWheel.release, now)

    def power_cycle(self, now: float) -> None:
        """Switch it off and on: what was saved stays, the rest is forgotten, counting begins at zero."""
        self.advance(now)
        self.restarts += 1
        self._words = {**_defaults(), **self.eeprom}
        self.address = self.value(r.NODE_ID)
        if r.BAUD_RATE.address in self.eeprom:
            self.baudrate = int(BaudRate(self.value(r.BAUD_RATE)).name.removeprefix("BAUD_"))
        locked = self.value(r.POWER_ON_SHAFT) is PowerOnShaft.LOCKED
        self._each(3, lambda wheel, now: wheel.power_on(locked, now), now)
        self._heard_at = self._ready_at = now + self.restart_takes

    # The wire

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        self.advance(now)
        if now < self._ready_at or broadcast:
            return None  # no broadcast is documented
        self._heard_at = now
        address = int.from_bytes(pdu[1:3], "big")
        if pdu[0] == 3 and len(pdu) == 5:
            data = self._read(address, int.from_bytes(pdu[3:5], "big"), now)
            return bytes((3, len(data))) + data
        if pdu[0] == 6 and len(pdu) == 5:
            self._write(address, pdu[3:], now)
            return pdu
        if pdu[0] == 16 and len(pdu) > 6:
            if pdu[5] != len(pdu) - 6 or pdu[5] != 2 * int.from_bytes(pdu[3:5], "big"):
                raise Refusal(ILLEGAL_VALUE)
            self._write(address, pdu[6:], now)
            return pdu[:5]
        raise Refusal(ILLEGAL_FUNCTION)

    def _read(self, address: int, count: int, now: float) -> bytes:
        words = {**self._words, **self._report(now)}
        try:
            return b"".join(words[address + at].to_bytes(2, "big") for at in range(count))
        except KeyError:
            raise Refusal(ILLEGAL_ADDRESS) from None

    def _write(self, address: int, data: bytes, now: float) -> None:
        """Take words, lowest address first. Nothing is taken where one is refused."""
        words = {address + at: int.from_bytes(data[2 * at : 2 * at + 2], "big") for at in range(len(data) // 2)}
        if not words.keys() <= self._words.keys():
            raise Refusal(ILLEGAL_ADDRESS)
        old, self._words = self._words, {**self._words, **words}
        written = [register for at in words if (register := r.BY_ADDRESS.get(at)) is not None]
        try:
            values = [(register, self.value(register)) for register in written]
            for register, value in values:
                register.raw(value)
        except (ValueError, LimitExceeded):
            self._words = old
            raise Refusal(ILLEGAL_VALUE) from None
        for at, word in words.items():
            if at in r.SAVED or (self.value(r.SAVE_WRITES) and at != r.SAVE_WRITES.address):
                self.eeprom[at] = word
                self.eeprom_writes += 1
        for register, value in values:
            if (command := self._commands.get(register.address)) is not None:
                command(value, now)

    def _report(self, now: float) -> dict[int, int]:
        """What 0x2003, 0x2004 and 0x20A0 to 0x20B0 read."""
        alarm = any(wheel.faults for wheel in self.wheels)
        levels = self.pressed ^ self.value(r.INPUTS_REVERSED)
        mute = self.mode.is_position and not self.rpm_in_position_mode
        motion = r.MOTION.encode(
            *(wheel.counts(now) for wheel in self.wheels),
            *(0 if mute else wheel.motor.rpm(now) for wheel in self.wheels),
            *(wheel.torque(now) for wheel in self.wheels),
        )
        halves = [wheel.state << 6 | wheel.motor.moving(now + self.status_lag) for wheel in self.wheels]
        low, high = halves if self.status_word_left == "low" else reversed(halves)
        (left, right), faults = self.wheels, [wheel.faults for wheel in self.wheels]
        data = r.REPORT.encode(
            *(self.version, self.bus_voltage, high << 8 | low),
            *(left.hall, right.hall, left.temperature, right.temperature, *faults),
            *r.MOTION.decode(motion),
            *(1, self.temperature),
        )
        words = {
            r.REPORT.address + at: int.from_bytes(data[2 * at : 2 * at + 2], "big") for at in range(r.REPORT.count)
        }
        return {**words, r.INPUTS.address: levels, r.OUTPUTS.address: Outputs.Y0 if alarm else Outputs(0)}

    # Commands

    @property
    def _emergency_input(self) -> bool:
        functions = ((Inputs.X0, r.X0_FUNCTION), (Inputs.X1, r.X1_FUNCTION))
        return any(x in self.pressed and self.value(does) is InputFunction.EMERGENCY_STOP for x, does in functions)

    def _control(self, word: ControlWord, now: float) -> None:
        synchronous = self.value(r.SYNCHRONY) is Synchrony.SYNCHRONOUS
        if word is ControlWord.EMERGENCY_STOP:
            self._each(3, lambda wheel, now: wheel.quick_stop(ShaftState.EMERGENCY_STOP, now), now)
        elif word is ControlWord.CLEAR_FAULT:
            self._each(3, SimWheel.clear_faults, now)
        elif word is ControlWord.RELEASE:
            self._each(3, SimWheel.release, now)
        elif word is ControlWord.ENABLE:
            if not self._emergency_input and not any(wheel.faults for wheel in self.wheels):
                self._each(3, SimWheel.enable, now)
        elif word is ControlWord.START_BOTH and synchronous:
            self._each(3, SimWheel.start, now)
        elif word in (ControlWord.START_LEFT, ControlWord.START_RIGHT) and not synchronous:
            self._each(Side.LEFT if word is ControlWord.START_LEFT else Side.RIGHT, SimWheel.start, now)

    def _change_mode(self, mode: ControlMode, now: float) -> None:
        if self.mode_change_releases:
            self._each(3, SimWheel.release, now)
        self._each(3, SimWheel.obey, now)

    def _target(self, wheel: SimWheel, mode: ControlMode, now: float) -> None:
        if self.mode is mode:
            wheel.obey(now)

    def _restore(self, really: bool, now: float) -> None:
        if really:
            self.eeprom = {r.NODE_ID.address: self.address}
            self.power_cycle(now)

    def _each(self, which: int, do: Callable[[SimWheel, float], None], now: float) -> None:
        for wheel in self.wheels:
            if wheel.side & which:
                do(wheel, now)


def _defaults() -> dict[int, int]:
    """Every word that can be written, as shipped."""
    words = {}
    for register in r.ALL:
        if register.access != "r":
            data = register.encode(register.default)
            words.update(
                {register.address + at // 2: int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)}
            )
    return words
