"""One axis as its group sees it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.motion.commands import AxisCommands
from rs485bus.motion.drive import Drive
from rs485bus.motion.group.member import GroupCoordinator, GroupMember, GroupMemberMove
from rs485bus.motion.move import Move, MoveTarget
from rs485bus.motion.parameters import MotionParameters, Paced, quickest
from rs485bus.motion.scale import AxisScale
from rs485bus.motion.stop_control import StopControl
from rs485bus.wire.frames import Request


class AxisMember:
    """What a group tells an axis, and asks it: see `GroupMember`.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        number: which one of the drive's axes it is.
        name: names it in messages.
        own: its speed and its acceleration, as its user has set them.
        scale: its units.
        stops: stops it.
        commands: queues its commands.
        carry_out: carries out its part of a move, once its group has met.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        number: int,
        name: str,
        own: Paced,
        scale: AxisScale,
        stops: StopControl,
        commands: AxisCommands,
        carry_out: Callable[[Move, MoveTarget, MotionParameters], Awaitable[float]],
    ) -> None:
        self.bus = bus
        self.name = name
        self.attached: DeviceAdapter = drive
        self.accompany: Callable[[Mapping[GroupMember, GroupMemberMove]], None] = lambda moves: None
        self._drive = drive
        self._at = number
        self._own = own
        self._scale = scale
        self._stops = stops
        self._commands = commands
        self._carry_out = carry_out

    # How fast it can go

    @property
    def rpm(self) -> float:
        return self._own.rpm

    @property
    def acceleration(self) -> float:
        return self._own.acceleration

    @property
    def highest_rpm(self) -> float:
        return self._scale.ability.highest_rpm

    @property
    def rpm_step(self) -> float:
        return self._scale.ability.rpm_step

    def lowest_acceleration(self, rpm: float) -> float:
        return self._scale.ability.lowest_acceleration(rpm)

    def position_pace(self, rpm: float, acceleration: float) -> MotionParameters:
        return self._scale.position_parameters(rpm, acceleration)

    # Where it goes

    @property
    def planned(self) -> float | None:
        return self._commands.planned

    def goal_to(self, position: float) -> MoveTarget:
        return self._commands.goal_to(position)

    def goal_by(self, distance: float) -> MoveTarget:
        return self._commands.goal_by(distance)

    def way(self, start: float, end: float) -> float:
        return self._commands.way(start, end)

    def join(self, goal: MoveTarget, who: str, coordinator: GroupCoordinator) -> GroupMemberMove:
        def carry_out(move: Move) -> Awaitable[float]:
            return self._carry_out(move, goal, quickest(self, min(self.rpm, self.highest_rpm)))

        return self._commands.join(goal, who, coordinator, carry_out)

    def start_frame(self, target: int, pace: MotionParameters) -> Request:
        return self._drive.start_frame(self._at, target, pace)

    # How it ends

    @property
    def condition(self) -> str:
        return self._stops.condition

    def give_up(self, handle: Handle[Any], error: Exception) -> None:
        self._stops.give_up(handle, error)

    def stop_if_moving(self) -> None:
        self._stops.stop_if_moving()
