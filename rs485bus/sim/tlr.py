"""A virtual TL-R drive. Source: TL-R manual; what it leaves open is an option of the drive."""

from __future__ import annotations

from typing import Literal

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.alarms import alarm_of
from rs485bus.devices.tlr.values import Auxiliary, ControlWord, DiFunction, OperatingMode, Ports, StatusWord
from rs485bus.sim.device import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, Refusal, SimUnit, remember
from rs485bus.sim.tlr_inputs import TlrInputs
from rs485bus.sim.tlr_machine import Dip, TlrMachine
from rs485bus.sim.tlr_memory import Memory
from rs485bus.sim.tlr_motion import Activity, Denied, TlrMotion

DENIED = 4
_POWER_UP_TAKES = 0.5
_LAST_OF_BLOCK = 5
"""Registers from which on a write is truncated, by firmware that does that."""
_STARTS = ControlWord.POSITION | ControlWord.JOG | ControlWord.HOME


class SimTlr(SimUnit):
    """A drive, its motor, and the machine on its shaft.

    Args:
        address: 1..247. Up to 15 it is set by the DIP switches, from there on by PA_020.
        dip: the switches; None for those that make the address.
        shaft: where the shaft stands, in turns of the machine.
        machine: what the shaft drives.
        subdivision: pulses a turn, 400..51200.
        operating_mode: how the motor is driven.
        trigger: what starts something: the rising "edge" of its bit, or every "write" that has it set. Drives of the
            second kind read such bits back as 0. The auxiliary control is taken in the same way.
        truncates: how many registers it keeps of a write of five or more; None for all.
        admits_truncation: it says so in its answer.
        denies: what it cannot do now is refused with exception 04; otherwise it is acknowledged and ignored.
        keeps_target: 0x33 to 0x38 hold what was written until it is switched off; otherwise a trigger uses it up.
        live_jog: a jog under way takes a new speed.
        jog_by_level: a jog lasts as long as its bit is set, and slows down when that is taken back.
        enabled_bit: what status bit 4 says; None for the truth.
        enabled_at_power_on: whether it is energised then.
        ramp_rpm: the speed that ramp times refer to; None for that of the move.
        goes_to_offset: after homing it goes to the offset; otherwise the origin has that position.
        status_lag: seconds before the shaft stands in which the status says already that it does.
        unknown_bits: bits of the status that the manual does not name, and that are set.
        serial_at_once: station and baud rate count when they are written; otherwise after a power cycle.
    """

    def __init__(
        self,
        address: int = 1,
        *,
        dip: Dip | None = None,
        shaft: float = 0.0,
        machine: TlrMachine | None = None,
        subdivision: int = 4000,
        operating_mode: OperatingMode = OperatingMode.CLOSED_LOOP,
        trigger: Literal["edge", "write"] = "edge",
        truncates: int | None = None,
        admits_truncation: bool = False,
        denies: bool = True,
        keeps_target: bool = True,
        live_jog: bool = False,
        jog_by_level: bool = False,
        enabled_bit: bool | None = None,
        enabled_at_power_on: bool = True,
        ramp_rpm: float | None = None,
        goes_to_offset: bool = True,
        status_lag: float = 0.0,
        unknown_bits: int = 0,
        serial_at_once: bool = False,
    ) -> None:
        super().__init__(address, {})
        self.dip = dip or Dip(address if address <= 15 else 0)
        self.trigger = trigger
        self.truncates = truncates
        self.admits_truncation = admits_truncation
        self.denies = denies
        self.keeps_target = keeps_target
        self.live_jog = live_jog
        self.jog_by_level = jog_by_level
        self.enabled_bit = enabled_bit
        self.enabled_at_power_on = enabled_at_power_on
        self.status_lag = status_lag
        self.unknown_bits = unknown_bits
        self.serial_at_once = serial_at_once
        self.software_version, self.hardware_version = 0x0102, 0x0100
        self.power_cycles = 0
        self.memory = Memory(subdivision, address, operating_mode)
        self.motion = TlrMotion(self.memory, machine or TlrMachine(), shaft, ramp_rpm, goes_to_offset)
        self.inputs = TlrInputs(self.memory, self.motion)
        self.motion.inputs_changed = self.inputs.update
        self._ready_at = 0.0
        self._power_on(0.0)

    # What one sees of it

    @property
    def moves(self) -> int:
        """How often it was set in motion."""
        return self.motion.moves

    @property
    def enabled(self) -> bool:
        """Whether the motor is held."""
        return self.motion.enabled and DiFunction.RELEASE not in self.motion.active

    def shaft(self, now: float) -> float:
        """Where its shaft is, in turns of the machine."""
        self.motion.advance(now)
        return self.motion.shaft(now)

    def moving(self, now: float) -> bool:
        """Whether its shaft turns."""
        self.motion.advance(now)
        return self.motion.motor.moving(now)

    def rpm(self, now: float) -> float:
        """How fast its shaft turns."""
        self.motion.advance(now)
        return self.motion.motor.rpm(now)

    # What happens to it

    def close(self, port: int, closed: bool, now: float) -> None:
        """Close or open the contact on an input, 0..4."""
        self.motion.advance(now)
        bit = Ports(1 << port)
        self.inputs.contacts = self.inputs.contacts | bit if closed else self.inputs.contacts & ~bit
        self.inputs.update(now)

    def fail(self, alarm: int, now: float) -> None:
        """Let something go wrong: 1..5 (3.6)."""
        self.motion.advance(now)
        self.motion.fail(alarm, now)

    def power_cycle(self, now: float, *, dropped: float = 0.0) -> None:
        """Switch it off and on. Meanwhile the shaft turns by so much."""
        self.motion.advance(now)
        self.power_cycles += 1
        self.memory.restart()
        self.motion.motor.place(self.motion.motor.position(now) + dropped, now)
        self._power_on(now)
        self._ready_at = now + _POWER_UP_TAKES

    def _power_on(self, now: float) -> None:
        self._take_serial()
        self.motion.reset(now, self.enabled_at_power_on)
        self.inputs.power_on(now)

    def _take_serial(self) -> None:
        """What the DIP switches leave to be set (2.2.4)."""
        self.address = self.dip.station or self.memory.get(r.STATION)
        self.baudrate = self.memory.get(r.BAUD_RATE).baudrate if self.dip.custom_baudrate else 115200

    # The wire

    def receive(self, frame: bytes, now: float) -> bytes | None:
        self.motion.advance(now)
        return None if now < self._ready_at else super().receive(frame, now)

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        if pdu[0] not in (3, 6, 16):
            raise Refusal(ILLEGAL_FUNCTION)
        reply = super().answer(pdu, now, broadcast=broadcast)
        if pdu[0] == 16 and reply is not None and self.admits_truncation:
            return reply[:3] + len(self.writes[-1][2]).to_bytes(2, "big")
        return reply

    def read(self, register: int, count: int, now: float) -> list[int]:
        words = {**self.memory.words, **self._monitored(now)}
        try:
            return [words[address] for address in range(register, register + count)]
        except KeyError:
            raise Refusal(ILLEGAL_ADDRESS) from None

    def _monitored(self, now: float) -> dict[int, int]:
        motion = self.motion
        told = self.enabled if self.enabled_bit is None else self.enabled_bit
        status = motion.status(now) & (-1 if motion.running(now + self.status_lag) else ~StatusWord.RUNNING)
        pulses = motion.pulses(now) % 0x1_0000_0000
        return {
            r.SOFTWARE_VERSION.address: self.software_version,
            r.HARDWARE_VERSION.address: self.hardware_version,
            r.STATUS.address: status | (StatusWord.ENABLED if told else 0) | self.unknown_bits,
            r.ALARM.address: motion.alarm,
            r.INPUT_STATES.address: self.inputs.states(now),
            r.OUTPUT_STATES.address: self.inputs.outputs(now, self.enabled),
            r.POSITION.address: pulses >> 16,
            r.POSITION.address + 1: pulses & 0xFFFF,
            r.SPEED.address: round(motion.rpm(now)) % 0x10000,
        }

    def write(self, register: int, values: tuple[int, ...], now: float) -> None:
        self.memory.check(register, values)
        if self.truncates is not None and len(values) >= _LAST_OF_BLOCK:
            values = values[: self.truncates]
        for address, value in enumerate(values, register):
            before = self.memory.words[address]
            if address == r.CONTROL.address:
                self._control(ControlWord(value), ControlWord(before), now)
            elif address == r.AUXILIARY.address:
                self._auxiliary(value, before, now)
            else:
                self.memory.words[address] = value
        remember(self.writes, (now, register, values))
        if self.serial_at_once:
            self._take_serial()
        if self.live_jog and register == r.JOG.address and self.motion.activity is Activity.JOGGING:
            self.motion.jog(*self.memory.block(r.JOG), now=now)
        self.inputs.update(now)

    # Commands

    def _control(self, word: ControlWord, before: ControlWord, now: float) -> None:
        rises = word & ~before if self.trigger == "edge" else word
        jog_ends = self.jog_by_level and ControlWord.JOG in before and ControlWord.JOG not in word
        if jog_ends and self.motion.activity is Activity.JOGGING:
            self.motion.stop(now)
        if ControlWord.EMERGENCY_STOP in rises:
            self.motion.halt(now)
        elif ControlWord.STOP in rises:
            self.motion.stop(now)
        elif not word & (ControlWord.STOP | ControlWord.EMERGENCY_STOP):
            try:
                self._start(rises, word, now)
            except Denied:
                if self.denies:
                    raise Refusal(DENIED) from None
        self.memory.words[r.CONTROL.address] = word if self.trigger == "edge" else word & ~_STARTS

    def _start(self, rises: ControlWord, word: ControlWord, now: float) -> None:
        if ControlWord.HOME in rises:
            self.motion.home(now)
        elif ControlWord.POSITION in rises:
            self.motion.position(
                *self.memory.block(r.POSITIONING),
                relative=ControlWord.ABSOLUTE not in word,
                interrupt=ControlWord.INTERRUPT in word,
                now=now,
            )
            if not self.keeps_target:
                self.memory.words.update(dict.fromkeys(range(r.POSITIONING.address, r.TARGET.address + 2), 0))
        elif ControlWord.JOG in rises:
            self.motion.jog(*self.memory.block(r.JOG), now=now)

    def _auxiliary(self, value: int, before: int, now: float) -> None:
        self.memory.words[r.AUXILIARY.address] = value
        if self.trigger == "edge" and value == before:
            return
        command = Auxiliary(value)
        motion = self.motion
        if command is Auxiliary.FACTORY_RESET:
            self.memory.reset()
        elif command is Auxiliary.SAVE:
            self.memory.save()
        elif command is Auxiliary.CLEAR_ALARM:
            alarm = alarm_of(motion.alarm)
            if alarm is not None and not alarm.power_cycle:
                motion.alarm = 0
        elif command is Auxiliary.CLEAR_POSITION:
            motion.clear_position(now)
        elif command is Auxiliary.ENABLE:
            if motion.alarm:
                if self.denies:
                    raise Refusal(DENIED)
                return
            motion.enabled = True
        elif command is Auxiliary.RELEASE:
            motion.halt(now)
            motion.enabled = False
