"""The virtual drives of a run: what can happen to each, and how the oracle sees its shafts."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rs485bus import Bus, MksServo, TlrStepper, Zlac8015d
from rs485bus.devices.tlr.values import OperatingMode
from rs485bus.devices.zlac import Fault, Side
from rs485bus.devices.zlac.values import Inputs as ZlacInputs
from rs485bus.devices.zlac.values import ShaftState
from rs485bus.sim.campaigns.faults.evidence import Mishap, Shaft
from rs485bus.sim.device import SimDevice
from rs485bus.sim.mks import SimMks
from rs485bus.sim.mks_machine import Machine
from rs485bus.sim.motor import Motor
from rs485bus.sim.tlr import SimTlr
from rs485bus.sim.tlr_machine import TlrMachine
from rs485bus.sim.treatment import PLAIN as TREATED_WELL
from rs485bus.sim.treatment import Treatment
from rs485bus.sim.zlac import SimZlac

_HEAVY = 9000
"""mA that no motor has."""
_PRESSED_FOR = 0.3


@dataclass(frozen=True, slots=True)
class Option:
    """A reading of a manual, or a quirk: how the virtual drive is made, and what its facade is told of that."""

    says: str
    sim: Mapping[str, Any] = field(default_factory=dict)
    facade: Mapping[str, Any] = field(default_factory=dict)
    slack: float = 0.0
    """Turns by which such a drive may be off, beside the usual ones."""
    treats: Callable[[Drive, bytes, float], Treatment] | None = None
    """What becomes of a frame to such a drive, at that time, where nothing else goes wrong."""
    spoils: bool = False
    """Such a drive spoils attempts of its own: one more that is lost may be the last, and change how a call ends."""
    bus: Mapping[str, Any] = field(default_factory=dict)
    """What its bus is told of it, as arguments of `BusConfig`."""


class Drive(ABC):
    """One virtual drive under test."""

    family: str
    lets_go_of_a_load = False
    """It lets go of a shaft that something blocks."""
    restarts_for: float
    """Seconds for which it is deaf when it is switched on."""

    def __init__(self, address: int, option: Option) -> None:
        self.address = address
        self.option = option
        self.shafts = self._make_shafts()
        for shaft in self.shafts:
            shaft.slack += option.slack
        self._counted = [0] * len(self.shafts)
        self.heard = 0
        """Frames that were for it."""
        self.later: list[tuple[float, Callable[[float], None]]] = []
        """What still happens to it, and when."""

    @property
    @abstractmethod
    def sim(self) -> SimDevice:
        """What hangs on the line."""

    @abstractmethod
    def _make_shafts(self) -> list[Shaft]: ...

    @abstractmethod
    def facade(self, bus: Bus, **options: Any) -> Any:
        """The facade for it."""

    @abstractmethod
    def motors(self, now: float) -> list[tuple[float, float, int]]:
        """Of each shaft: position, speed, and a number that grows when a frame sets it in motion."""

    @property
    @abstractmethod
    def watchdog_ms(self) -> int:
        """What its watchdog is set to; 0 for off, or none."""

    @property
    def trips(self) -> list[float]:
        """When its watchdog stopped it."""
        return []

    def treat(self, frame: bytes, now: float) -> Treatment:
        """A frame is for it: what becomes of that, as it is."""
        self.heard += 1
        return TREATED_WELL if self.option.treats is None else self.option.treats(self, frame, now)

    def turns(self, now: float) -> bool:
        """Whether one of its shafts turns."""
        return any(rpm for _, rpm, _ in self.motors(now))

    def look(self, now: float, told_at: float) -> bool:
        """Write down where its shafts are; whether one of them turns.

        Args:
            now: the time.
            told_at: when it was told something last.
        """
        while self.later and self.later[0][0] <= now:
            when, happen = self.later.pop(0)
            happen(when)
        turning = False
        for at, (shaft, (position, rpm, starts)) in enumerate(zip(self.shafts, self.motors(now), strict=True)):
            if starts > self._counted[at]:
                shaft.starts.append(told_at)
            self._counted[at] = starts
            shaft.add(now, position, rpm)
            if not shaft.answers_at or shaft.answers_at[-1][1] != self.sim.address:
                shaft.answers_at.append((now, self.sim.address))
            turning = turning or rpm != 0
        return turning

    # What happens to it

    def restart(self, now: float) -> None:
        """It is switched off and on."""
        self._happens("restart", now)
        for shaft in self.shafts:
            shaft.deaf.append((now, now + self.restarts_for))
        self._restart(now)

    def fault(self, now: float) -> None:
        """It reports an error of its own and lets go."""
        self._happens("fault", now, lets_go=True)
        self._fault(now)

    def limit(self, now: float) -> None:
        """A limit switch closes in its way, where it has one."""
        if self._limit(now):
            self._happens("limit", now)

    def stall(self, now: float) -> None:
        """Something blocks its shaft."""
        self._happens("stall", now, lets_go=self.lets_go_of_a_load)
        self._stall(now)

    def trip(self, now: float) -> None:
        """Its watchdog stops it, which somebody else has left armed, or which was fed too late."""
        if self._trip(now):
            self._happens("trip", now, lets_go=self.option.sim.get("trip_state") is ShaftState.RELEASED)

    def _happens(self, what: str, now: float, *, lets_go: bool = False) -> None:
        for shaft in self.shafts:
            shaft.mishaps.append(Mishap(now, what, lets_go))

    @abstractmethod
    def _restart(self, now: float) -> None: ...

    @abstractmethod
    def _fault(self, now: float) -> None: ...

    @abstractmethod
    def _limit(self, now: float) -> bool: ...

    @abstractmethod
    def _stall(self, now: float) -> None: ...

    def _trip(self, now: float) -> bool:
        return False


class MksUnderTest(Drive):
    """An MKS servo; its origin switch closes half a turn below where it stands."""

    family = "mks"
    restarts_for = 0.6

    def _make_shafts(self) -> list[Shaft]:
        start = 0.1 * self.address
        machine = Machine(home_switch=start - 0.5, **self.option.sim.get("machine", {}))
        sim = {name: value for name, value in self.option.sim.items() if name != "machine"}
        self._sim = SimMks(self.address, shaft=start, machine=machine, **sim)
        pulses = 200 * int(sim.get("microsteps", 16))
        return [Shaft(f"mks {self.address}", self.address, home=start - 0.5, pulses_per_turn=pulses)]

    @property
    def sim(self) -> SimMks:
        return self._sim

    def facade(self, bus: Bus, **options: Any) -> MksServo:
        return MksServo(bus, self.address, **{"rpm": 600.0, "acceleration": 20_000.0, **self.option.facade, **options})

    def motors(self, now: float) -> list[tuple[float, float, int]]:
        return [(self._sim.shaft(now), self._sim.motion.motor.rpm(now), self._sim.moves)]

    @property
    def watchdog_ms(self) -> int:
        return self._sim.watchdog_ms

    @property
    def trips(self) -> list[float]:
        return self._sim.trips

    def _restart(self, now: float) -> None:
        self._sim.restart(now)

    def _fault(self, now: float) -> None:
        self._sim.advance(now)
        self._sim.motion.protect(now)

    def _limit(self, now: float) -> bool:
        here, rpm, machine = self._sim.shaft(now), self._sim.motion.motor.rpm(now), self._sim.motion.machine
        if self._sim.motion.activity is not None:
            return False  # homing looks for the switch
        if rpm < 0:
            machine.home_switch = here
            self.shafts[0].homes.append((now, here))
        else:
            machine.right_switch = here
        self._sim.advance(now)
        return bool(rpm) and self._sim.motion.limited

    def _stall(self, now: float) -> None:
        self._sim.put_load(_HEAVY, now)

    def _trip(self, now: float) -> bool:
        self._sim.advance(now)
        self._sim.trip(now)
        return True


class ZlacUnderTest(Drive):
    """A ZLAC drive with two wheels."""

    family = "zlac"
    lets_go_of_a_load = True
    restarts_for = 1.0

    def _make_shafts(self) -> list[Shaft]:
        self._sim = SimZlac(self.address, **self.option.sim)
        self._wishes = [0.0, 0.0]
        self._starts = [0, 0]
        left, right = f"zlac {self.address} left", f"zlac {self.address} right"
        return [Shaft(left, self.address, together=(right,)), Shaft(right, self.address, together=(left,))]

    @property
    def sim(self) -> SimZlac:
        return self._sim

    def facade(self, bus: Bus, **options: Any) -> Zlac8015d:
        return Zlac8015d(bus, self.address, **{"rpm": 200.0, "acceleration": 2000.0, **self.option.facade, **options})

    def motors(self, now: float) -> list[tuple[float, float, int]]:
        self._sim.advance(now)
        motors = []
        for at, wheel in enumerate(self._sim.wheels):
            wish = _final_rpm(wheel.motor)
            self._starts[at] += wish > self._wishes[at] + 1e-6
            self._wishes[at] = wish
            motors.append((wheel.motor.position(now), wheel.motor.rpm(now), self._starts[at] + wheel.moves))
        return motors

    @property
    def watchdog_ms(self) -> int:
        return self._sim.watchdog_ms

    @property
    def trips(self) -> list[float]:
        return self._sim.trips

    def _restart(self, now: float) -> None:
        self._sim.power_cycle(now)

    def _fault(self, now: float) -> None:
        self._sim.fail(Side.LEFT, Fault.OVER_CURRENT, now)

    def _limit(self, now: float) -> bool:
        """It has no limit switches; its emergency stop input is pressed for a while."""
        self._sim.press(ZlacInputs.X0, now)
        self.later.append((now + _PRESSED_FOR, lambda now: self._sim.press(ZlacInputs(0), now)))
        return True

    def _stall(self, now: float) -> None:
        self._sim.fail(Side.RIGHT, Fault.OVER_LOAD, now)

    def _trip(self, now: float) -> bool:
        self._sim.trip(now)
        return True


class TlrUnderTest(Drive):
    """A TL-R stepper; its origin switch is closed from 0.6 to 0.5 turns below where it stands."""

    family = "tlr"
    restarts_for = 0.5

    def _make_shafts(self) -> list[Shaft]:
        start = 0.1 * self.address
        machine = TlrMachine(origin=(start - 0.6, start - 0.5), **self.option.sim.get("machine", {}))
        sim = {name: value for name, value in self.option.sim.items() if name != "machine"}
        self._sim = SimTlr(self.address, shaft=start, machine=machine, **sim)
        return [Shaft(f"tlr {self.address}", self.address, home=start - 0.6)]

    @property
    def sim(self) -> SimTlr:
        return self._sim

    def facade(self, bus: Bus, **options: Any) -> TlrStepper:
        return TlrStepper(
            bus, self.address, **{"rpm": 600.0, "acceleration": 20_000.0, **self.option.facade, **options}
        )

    def motors(self, now: float) -> list[tuple[float, float, int]]:
        return [(self._sim.shaft(now), self._sim.rpm(now), self._sim.moves)]

    @property
    def watchdog_ms(self) -> int:
        return 0

    def _restart(self, now: float) -> None:
        self._sim.power_cycle(now)

    def _fault(self, now: float) -> None:
        self._sim.fail(1, now)

    def _limit(self, now: float) -> bool:
        rpm = self._sim.rpm(now)
        self._sim.close(2 if rpm < 0 else 1, True, now)
        return bool(rpm)

    def _stall(self, now: float) -> None:
        here, rpm = self._sim.shaft(now), self._sim.rpm(now)
        low, high = self._sim.motion.machine.travel
        self._sim.motion.machine.travel = (here if rpm < 0 else low, here if rpm > 0 else high)
        self._sim.motion.advance(now)
        if self.option.sim.get("operating_mode") is OperatingMode.OPEN_LOOP:
            self.shafts[0].slack = math.inf  # without an encoder nobody knows what it has lost


def _final_rpm(motor: Motor) -> float:
    """How fast it turns once it has done what it was told."""
    return abs(motor.rpm(motor.arrives_at)) if motor.target is None and math.isfinite(motor.arrives_at) else 0.0


KINDS: dict[str, type[Drive]] = {kind.family: kind for kind in (MksUnderTest, ZlacUnderTest, TlrUnderTest)}
