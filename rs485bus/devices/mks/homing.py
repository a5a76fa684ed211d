"""How an MKS drive homes. Source: MKS RTU V1.0.9, 5."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.arguments import flag, instance, real
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import check_current, write_block
from rs485bus.devices.mks.values import HomingMode, Level, Model, ParameterDirection, SingleTurn, ZeroPoint
from rs485bus.wire.frames import Request

_USUAL_OFFSET = 0x2000
_USUAL_CURRENT = 400


@dataclass(frozen=True, slots=True)
class EndLimits:
    """What the limit switches do, as far as is known: as shipped, or as a drive has acknowledged."""

    trigger: Level = Level.LOW
    """The level of IN_1 when the switch is closed."""
    on: bool = False
    """They limit every motion (6)."""


_AS_SHIPPED = EndLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class SwitchHoming:
    """Look for the origin switch; where it closes is zero (5.1)."""

    direction: ParameterDirection = ParameterDirection.CW
    rpm: int = 60
    """0..3000."""
    trigger: Level = Level.LOW
    """The level of IN_1 when the switch is closed."""
    end_limits: bool | None = None
    """Let the switches limit every motion afterwards (6). They count from the next homing on (5.3.2). None leaves that
    as the drive has acknowledged it to this facade; where it has acknowledged nothing, they are off, as shipped."""

    def limits(self, known: EndLimits) -> EndLimits:
        """What the switches do afterwards."""
        return EndLimits(self.trigger, known.on if self.end_limits is None else self.end_limits)

    def frames(self, address: int, model: Model, known: EndLimits = _AS_SHIPPED) -> list[Request]:
        """What sets a drive up for it. Raises `LimitExceeded`."""
        limits = self.limits(known)
        return [
            write_block(address, r.HOMING, limits.trigger, self.direction, self.rpm, limits.on),
            write_block(address, r.HOMING_TORQUE, _USUAL_OFFSET, HomingMode.SWITCH, _USUAL_CURRENT),
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class StopHoming:
    """Run against a mechanical stop, and back by an offset; that is zero (5.1)."""

    direction: ParameterDirection = ParameterDirection.CW
    rpm: int = 60
    """0..3000."""
    current: int = 400
    """The current, in mA, with which it runs against the stop: just enough to move the load."""
    offset_turns: float = 0.5
    """How far it goes back, 0..262143 turns."""
    end_limits: bool | None = None
    """As for `SwitchHoming`."""

    def limits(self, known: EndLimits) -> EndLimits:
        """What the switches do afterwards."""
        return EndLimits(known.trigger, known.on if self.end_limits is None else self.end_limits)

    def frames(self, address: int, model: Model, known: EndLimits = _AS_SHIPPED) -> list[Request]:
        """What sets a drive up for it. Raises `LimitExceeded`."""
        check_current("homing current", model, self.current)
        offset = round(real("offset_turns", self.offset_turns) * r.COUNTS_PER_TURN)
        limits = self.limits(known)
        return [
            write_block(address, r.HOMING, limits.trigger, self.direction, self.rpm, limits.on),
            write_block(address, r.HOMING_TORQUE, offset, HomingMode.STOP, self.current),
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleTurnHoming:
    """Turn to the zero of the turn (5.1, 5.3.4). Once set up, the drive does so at every power-on, too (5.6).

    Setting it up is slow: the drive may answer only after 1.6 s. It is refused while a watchdog on the bus is armed.
    """

    direction: ParameterDirection | None = None
    """None for the nearest way."""
    speed: int = 2
    """0 (slowest) to 4 (fastest)."""
    set_zero_here: bool = False
    """Make the present position the zero of the turn."""

    def limits(self, known: EndLimits) -> EndLimits:
        """What the switches do afterwards: what they did before."""
        return known

    def frames(self, address: int, model: Model, known: EndLimits = _AS_SHIPPED) -> list[Request]:
        """What sets a drive up for it. Raises `LimitExceeded`."""
        mode = SingleTurn.NEAREST if self.direction is None else SingleTurn.BY_DIRECTION
        zero = ZeroPoint.SET_HERE if flag("set_zero_here", self.set_zero_here) else ZeroPoint.KEEP
        direction = ParameterDirection.CW if self.direction is None else self.direction
        return [
            write_block(address, r.HOMING_TORQUE, _USUAL_OFFSET, HomingMode.SINGLE_TURN, _USUAL_CURRENT),
            write_block(address, r.SINGLE_TURN, mode, zero, self.speed, direction),
        ]


Homing = SwitchHoming | StopHoming | SingleTurnHoming


def homing_frames(address: int, model: Model, homing: Homing, known: EndLimits = _AS_SHIPPED) -> list[Request]:
    """What sets a drive up for a way of homing. What the limit switches do stays as it is `known`, unless asked for.

    Raises:
        LimitExceeded: a value is out of its range.
        TypeError: it is no way of homing.
    """
    kinds = (SwitchHoming, StopHoming, SingleTurnHoming)
    return instance("homing", homing, kinds, "SwitchHoming(), StopHoming() or SingleTurnHoming()").frames(
        address, model, known
    )
