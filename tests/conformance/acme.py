"""A family that nobody makes: a drive with one control word, and a block of targets that is read back before a start.

It stands for a package of others. `rs485bus/guide/new-family.md` says how it was made.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from rs485bus import Bus
from rs485bus.bus.units.motion import Motion
from rs485bus.errors import LimitExceeded, MoveFailed, NotEnabled, NotSupported
from rs485bus.motion.axis import Axis
from rs485bus.motion.drive import NO_EFFECT, STOPS, Ability, Drive, Effect, Reading
from rs485bus.motion.move import Move
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Ask, Ended, Know, Plan, Start
from rs485bus.motion.standstill import StandstillRule
from rs485bus.motion.state import MOTION, AxisState, Fact, Facts
from rs485bus.motion.supervisor import Supervisor
from rs485bus.wire.frames import (
    WRITE_MULTIPLE,
    WRITE_SINGLE,
    Request,
    payload,
    read_holding,
    unit_address,
    write_multiple,
    write_single,
)

STATUS: Final = 0x00  # status, position (two registers, high first), speed, boots
TARGET: Final = 0x10  # target (two registers, high first), speed, ramp in rpm/s
CONTROL: Final = 0x20
ENABLED, MOVING, FAULT, LIMIT = 1, 2, 4, 8
ENABLE, DISABLE, GO, TURN, STOP, QUICK_STOP, ZERO, CLEAR, HOME = range(1, 10)
COUNTS, MAX_RPM, MAX_RAMP, MIN_RAMP = 1000, 2000, 20_000, 10
START_TAKES = 0.03
"""Seconds between a control word and the motion that it starts, at most."""
_JUMP = COUNTS * 5 // 360


class AcmeAbility(Ability):
    """Whole rpm, ramps of whole rpm/s."""

    counts_per_turn = COUNTS

    def __init__(self, name: str) -> None:
        self._name = name

    @property
    def target_range(self) -> tuple[int, int]:
        return -(1 << 31), (1 << 31) - 1

    @property
    def fastest(self) -> tuple[float, str]:
        return MAX_RPM, "as it is made"

    def lowest_acceleration(self, rpm: float) -> float:
        return MIN_RAMP

    def parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        if not MIN_RAMP <= acceleration <= MAX_RAMP:
            raise LimitExceeded(f"{self._name}: acceleration {acceleration:g} is outside {MIN_RAMP}..{MAX_RAMP} rpm/s")
        speed, ramp = max(1, round(rpm)), round(acceleration)
        return MotionParameters(float(speed), float(ramp), speed, ramp)

    def ticks(self, duration: float) -> int:
        raise NotSupported(f"{self._name} cannot be told for how long to run.")


class AcmeDrive(Drive):
    """One drive.

    Args:
        address: 1..247.
    """

    family = "Acme"
    start_grace = START_TAKES + 0.02
    causes = (Fact.FAULT, Fact.ENABLED, Fact.LIMIT)

    def __init__(self, address: int) -> None:
        name = f"Acme {address}"
        self._ability = AcmeAbility(name)
        facts = {Fact.POSITION, Fact.RUNNING, Fact.SPEED, Fact.ENABLED, Fact.FAULT, Fact.LIMIT}
        self._whole = read_holding(address, STATUS, 5)
        self._readings = (
            Reading(self._whole, frozenset(facts | {Fact.MARK}), _decode),
            Reading(read_holding(address, STATUS, 3), frozenset(facts - {Fact.SPEED}), _decode),
        )
        rule = StandstillRule(apart=3 * 60 / COUNTS, contradicted=0.3)
        super().__init__(name, address, (AxisState(Motion(), rule, _JUMP),))
        self.boots: int | None = None
        """How often it had started when that was last asked."""
        self.state.listen(self._see)

    @property
    def readings(self) -> Sequence[Reading]:
        return self._readings

    def marks(self, axis: int) -> tuple[Fact, ...]:
        return (Fact.MARK, Fact.POSITION, Fact.ENABLED)

    def _see(self) -> None:
        boots = self.state.axes[0].value(Fact.MARK)
        if boots is not None:
            if self.boots not in (None, boots):
                self.state.axes[0].suspect("it has started anew, and counts from zero where it stood then.")
            self.boots = boots

    def effects(self, request: Request) -> Sequence[Effect]:
        if request.function not in (WRITE_SINGLE, WRITE_MULTIPLE) or request.register != CONTROL:
            return (NO_EFFECT,)
        word = int.from_bytes(request.adu[4:6], "big")
        on = {ENABLE: True, DISABLE: False}.get(word)
        if word in (GO, TURN, HOME):
            return (Effect(MOTION | {Fact.LIMIT}, MAX_RPM, shifts=word == HOME),)
        if word == ZERO:
            return (Effect(frozenset({Fact.POSITION}), shifts=True),)
        return (STOPS if word in (STOP, QUICK_STOP) else Effect(frozenset({Fact.ENABLED, Fact.FAULT}), holds=on),)

    # Plans

    def enable(self, axis: int) -> Plan[None]:
        yield Ask(self.control(CLEAR))
        yield Ask(self.control(ENABLE))
        yield Know((Fact.ENABLED, Fact.FAULT))
        if not self.state.axes[0].value(Fact.ENABLED):
            raise NotEnabled(f"{self.name} does not take its motor on: {self.state.axes[0].value(Fact.FAULT)}")

    def disable(self, axis: int) -> Plan[None]:
        yield Ask(self.control(DISABLE))

    def zero(self, axis: int) -> Plan[None]:
        yield Ask(self.control(ZERO))

    def move(self, axis: int, target: int, parameters: MotionParameters) -> Plan[None]:
        yield from self._put(target, parameters.speed_code, parameters.ramp_code)
        yield self._start(GO, parameters)

    def run(self, axis: int, rpm: float, parameters: MotionParameters, ticks: int | None) -> Plan[None]:
        if rpm:
            yield from self._put(0, round(rpm), parameters.ramp_code)
        yield self._start(TURN if rpm else STOP, parameters)

    def home(self) -> Plan[None]:
        """Find the origin, and count from there."""
        axis = self.state.axes[0]
        yield Start(self.control(HOME), self.control(STOP), 0.5)
        yield Ended(lambda: axis.value(Fact.POSITION) is not None, (Fact.POSITION,), 60.0)

    def _put(self, target: int, speed: int, ramp: int) -> Plan[None]:
        """Write the block, and see that it is there: an acknowledged start does not prove that it arrived."""
        values = [*(target & 0xFFFFFFFF).to_bytes(4, "big")]
        words = [values[0] << 8 | values[1], values[2] << 8 | values[3], speed & 0xFFFF, ramp]
        yield Ask(write_multiple(self.address, TARGET, words))
        there = payload((yield Ask(read_holding(self.address, TARGET, 4))))
        if there != b"".join(word.to_bytes(2, "big") for word in words):
            raise MoveFailed(f"{self.name} did not keep what it was told of its move: {there.hex(' ')}")

    def _start(self, word: int, parameters: MotionParameters) -> Start:
        return Start(self.control(word), self.control(STOP), parameters.rpm / parameters.acceleration)

    def start_frame(self, axis: int, target: int, parameters: MotionParameters) -> Request:
        return self.control(GO)

    def setpoint(self, axis: int, rpm: float, acceleration: float, *, afresh: bool) -> Sequence[Request]:
        if not int(rpm):
            return (self.control(STOP),)
        ramp = max(MIN_RAMP, math.floor(min(acceleration, MAX_RAMP)))
        return write_multiple(self.address, TARGET + 2, [int(rpm) & 0xFFFF, ramp]), self.control(TURN)

    def control(self, word: int) -> Request:
        """What has it do something."""
        return write_single(self.address, CONTROL, word)

    def ability(self, axis: int) -> AcmeAbility:
        return self._ability

    # As the owner of the wire sees it

    def reads(self) -> Sequence[Request]:
        return tuple(reading.request for reading in self._readings)

    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        return (self.control(QUICK_STOP if emergency else STOP),)

    def slows_down_for(self, emergency: bool) -> float:
        return 0.1 if emergency else self.state.axes[0].ramp_takes + 0.1

    def hears(self, request: Request) -> bool:
        return request.writes


class AcmeServo(Axis):
    """An Acme drive as its users hold it. Arguments as for every axis."""

    def __init__(self, bus: Bus, address: int, *, tolerance: int | None = None) -> None:
        drive = AcmeDrive(unit_address(address))
        supervisor = Supervisor(bus, drive)
        super().__init__(
            bus,
            drive,
            0,
            drive.name,
            supervisor,
            units_per_turn=1.0,
            reverse=False,
            limits=None,
            rpm=300,
            acceleration=1000,
            tolerance=tolerance,
        )
        drive.on_interrupted = self._was_interrupted
        self._acme = drive
        bus.attach(self)

    def home(self) -> Move:
        """Find the origin, and count from there."""
        return self._seek("home", self._acme.home)


def _decode(data: bytes) -> Sequence[Facts]:
    words = [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]
    status, position = words[0], int.from_bytes(data[2:6], "big", signed=True)
    facts = {
        Fact.POSITION: position,
        Fact.RUNNING: bool(status & MOVING),
        Fact.ENABLED: bool(status & ENABLED),
        Fact.FAULT: f"fault {status >> 8}" if status & FAULT else "",
        Fact.LIMIT: "its limit switch is closed" if status & LIMIT else "",
    }
    if len(words) == 5:
        facts |= {Fact.SPEED: float(int.from_bytes(data[6:8], "big", signed=True)), Fact.MARK: words[4]}
    return (facts,)
