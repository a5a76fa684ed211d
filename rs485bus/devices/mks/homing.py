"""How an MKS drive homes. Source: MKS RTU V1.0.9, 5."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.arguments import instance, real
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import check_current, write_block
from rs485bus.devices.mks.values import HomingMode, Level, Model, ParameterDirection, SingleTurn, ZeroPoint
from rs485bus.wire.frames import Request

_USUAL_OFFSET = 0x2000
_USUAL_CURRENT = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class SwitchHoming:
    """Look for the origin switch; where it closes is zero (5.1)."""

    direction: ParameterDirection = ParameterDirection.CW
    rpm: int = 60
    """0..3000."""
    trigger: Level = Level.LOW
    """The level of IN_1 when the switch is closed."""
    end_limits: bool = False
    """Let the switches limit every motion afterwards (6). They count from the next homing on (5.3.2)."""

    def frames(self, address: int, model: Model) -> list[Request]:
        """What sets a drive up for it. Raises `LimitExceeded`."""
        return [
            write_block(address, r.HOMING, self.trigger, self.direction, self.rpm, self.end_limits),
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

    def frames(self, address: int, model: Model) -> list[Request]:
        """What sets a drive up for it. Raises `LimitExceeded`."""
        check_current("homing current", model, self.current)
        offset = round(real("offset_turns", self.offset_turns) * r.COUNTS_PER_TURN)
        return [
            write_block(address, r.HOMING, Level.LOW, self.direction, self.rpm, False),
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

    def frames(self, address: int, model: Model) -> list[Request]:
        """What sets a drive up for it. Raises `LimitExceeded`."""
        mode = SingleTurn.NEAREST if self.direction is None else SingleTurn.BY_DIRECTION
        zero = ZeroPoint.SET_HERE if self.set_zero_here else ZeroPoint.KEEP
        direction = ParameterDirection.CW if self.direction is None else self.direction
        return [
            write_block(address, r.HOMING_TORQUE, _USUAL_OFFSET, HomingMode.SINGLE_TURN, _USUAL_CURRENT),
            write_block(address, r.SINGLE_TURN, mode, zero, self.speed, direction),
        ]


Homing = SwitchHoming | StopHoming | SingleTurnHoming


def homing_frames(address: int, model: Model, homing: Homing) -> list[Request]:
    """What sets a drive up for a way of homing.

    Raises:
        LimitExceeded: a value is out of its range.
        TypeError: it is no way of homing.
    """
    kinds = (SwitchHoming, StopHoming, SingleTurnHoming)
    return instance("homing", homing, kinds, "SwitchHoming(), StopHoming() or SingleTurnHoming()").frames(
        address, model
    )
