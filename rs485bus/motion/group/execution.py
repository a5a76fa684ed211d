"""Several axes that make one move: they start together, arrive together, and stop together."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.burst import Burst, BurstSlot
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.errors import BusError, LimitExceeded, MoveCancelled, MoveFailed
from rs485bus.motion.group.barrier import Barrier
from rs485bus.motion.group.member import Course, GroupMember
from rs485bus.motion.move import MoveState, MoveTarget
from rs485bus.motion.parameters import fitting, quickest, slowest
from rs485bus.wire.frames import Request

_ROUNDING = 0.001
"""The part of a duration by which it may miss what an axis can do: whoever is told a shortest time may ask for it."""


@dataclass(frozen=True, slots=True)
class Wish:
    """How long a move of several axes is to take, in seconds; None for as long as the slowest needs. And the highest
    speed of any, in rpm; None for what each can do in that time, or else for its own."""

    duration: float | None = None
    rpm: float | None = None

    def highest(self, axis: GroupMember) -> float:
        """The highest speed, in rpm, that an axis may have."""
        wanted = self.rpm if self.rpm is not None else axis.rpm if self.duration is None else math.inf
        return min(wanted, axis.highest_rpm)

    def check_speed(self, axis: GroupMember) -> None:
        """Raise `LimitExceeded` for a speed that is lower than the axis can be told."""
        if self.rpm is not None and self.rpm < axis.rpm_step:
            raise LimitExceeded(
                f"{axis.name}: rpm {self.rpm:g} is less than its drive can be told, which is {axis.rpm_step:g} at "
                "least."
            )

    def check(self, axis: GroupMember, turns: float, late: float = 0.0) -> None:
        """Raise `LimitExceeded` where the duration is none that the axis can take for so many turns, if it starts so
        many seconds late."""
        if self.duration is None or not turns:
            return
        least = quickest(axis, self.highest(axis)).seconds(turns) + late
        if self.duration < least * (1 - _ROUNDING):
            raise LimitExceeded(
                f"{axis.name} needs {least:.3f} s at least for its {turns:.4g} turns, and {self.duration:g} s is "
                f"wanted. It may have {self.highest(axis):g} rpm and {axis.acceleration:g} rpm/s."
            )
        most = slowest(axis).seconds(turns) + late
        if self.duration > most * (1 + _ROUNDING):
            raise LimitExceeded(
                f"{axis.name} cannot be so slow that its {turns:.4g} turns take {self.duration:g} s: at its lowest "
                f"speed they take {most:.3f} s."
            )


class GroupExecution:
    """Axes on their way, each by a move of its own. Made once all was checked: the moves are queued at once.

    Args:
        axes: the axes, by name.
        goals: where each goes.
        wish: how fast.
        finished: called with the positions reached, when all have arrived.
        failed: called with the name of the one that failed, if it was one, and why, once the stops are on the wire.
    """

    def __init__(
        self,
        axes: Mapping[str, GroupMember],
        goals: Mapping[str, MoveTarget],
        wish: Wish,
        finished: Callable[[dict[str, float]], None],
        failed: Callable[[str | None, Exception], None],
    ) -> None:
        self._axes = axes
        self._wish = wish
        self._tell_finished = finished
        self._tell_failed = failed
        self._barrier: Barrier[str] = Barrier(axes)
        self._arrived: set[str] = set()
        self._all_arrived = asyncio.Event()
        self._positions: dict[str, float] = {}
        self._at_fault: str | None = None
        """Who cannot do what was wanted, as was found when all met."""
        self._over = False
        self._first: str | None = None
        """Who has failed first."""
        self._cause: str | None = None
        """Because of whom."""
        self._why: Exception | None = None
        self._unstopped = {axis.bus for axis in axes.values()}
        """Where not all stops are on the wire."""
        self.moves = {name: axis.join(goals[name], name, self) for name, axis in axes.items()}
        by_axis = {axis: self.moves[name] for name, axis in axes.items()}
        for axis in by_axis:
            axis.accompany(by_axis)

    # As each of them sees it

    async def meet(self, who: str) -> None:
        await self._barrier.meet(who, None, _nothing)

    async def agree(self, who: str, turns: float, target: int) -> Course:
        return (await self._barrier.meet(who, (turns, target), self._plan))[who]

    async def all_arrived(self, who: str, within: float) -> bool:
        self._arrived.add(who)
        if len(self._arrived) == len(self._axes):
            self._all_arrived.set()
        with anyio.move_on_after(within):
            await self._all_arrived.wait()
        return self._all_arrived.is_set()

    def finished(self, who: str, position: float) -> None:
        if self._over and who == self._first:
            self._conclude(MoveFailed(f"{self._axes[who].name} seemed to be held up, and its group was stopped."))
        self._positions[who] = position
        if len(self._positions) == len(self._axes):
            self._over = True
            self._tell_finished({name: self._positions[name] for name in self._axes})

    def stumbled(self, who: str) -> None:
        self._break_off(who)

    def broken(self, who: str, error: Exception) -> None:
        self._break_off(who)
        if who == self._first:
            self._conclude(error)

    def cancel(self, error: MoveCancelled) -> None:
        """End it, on nobody's account."""
        self._break_off(None)
        self._conclude(error)

    # Planning

    async def _plan(self, ways: dict[str, tuple[float, int]]) -> dict[str, Course]:
        """How fast each goes, so that all arrive at one time, though they start one after the other."""
        frames: dict[DeviceAdapter, tuple[Bus, Request]] = {}
        for name, axis in self._axes.items():
            turns, target = ways[name]
            frame = axis.start_frame(target, quickest(axis, self._wish.highest(axis)))
            frames.setdefault(axis.attached, (axis.bus, frame))
        late = _starts(frames)
        burst = Burst(len(frames))
        slots = {device: BurstSlot(burst, place) for place, device in enumerate(frames)}
        needed = []
        for name, axis in self._axes.items():
            turns, _ = ways[name]
            try:
                self._wish.check(axis, turns, late[axis.attached])
                needed.append(quickest(axis, self._wish.highest(axis)).seconds(turns) + late[axis.attached])
            except LimitExceeded:
                self._at_fault = name
                raise
        seconds = self._wish.duration or max(needed)
        courses = {}
        for name, axis in self._axes.items():
            turns, _ = ways[name]
            highest = self._wish.highest(axis)
            pace = fitting(axis, turns, seconds - late[axis.attached], highest) if turns else quickest(axis, highest)
            courses[name] = Course(pace, slots[axis.attached])
        return courses

    # Ending

    def _break_off(self, stumbling: str | None) -> None:
        """Stop all but the one that stumbles: it stops itself, and finds out why."""
        if self._over:
            return
        self._over = True
        self._first, self._cause = stumbling, self._at_fault or stumbling
        # Who has ended its part may be on its next command, which is none of this one's.
        under_way = (MoveState.STARTING, MoveState.MOVING)
        begun = [axis for name, axis in self._axes.items() if self.moves[name].state in under_way and name != stumbling]
        for name, axis in self._axes.items():
            if name != stumbling:
                axis.give_up(self.moves[name], MoveCancelled(f"Cancelled: {self.moves[name].what} has ended before."))
        # Who is being stopped for the same reason anyway, and faster perhaps, goes first.
        asyncio.get_running_loop().call_soon(self._stop, begun)

    def _stop(self, begun: list[GroupMember]) -> None:
        for axis in begun:
            with contextlib.suppress(BusError):  # one that cannot be stopped must not keep the others from it
                axis.stop_if_moving()
        self._unstopped = {axis.bus for axis in self._axes.values()}
        for bus in tuple(self._unstopped):
            bus.after_stops(functools.partial(self._stopped, bus))

    def _stopped(self, bus: Bus) -> None:
        """All stops for a bus are on the wire."""
        self._unstopped.discard(bus)
        self._tell()

    def _conclude(self, error: Exception) -> None:
        """It is known why it ends."""
        self._why = self._why or error
        self._tell()

    def _tell(self) -> None:
        """Tell everybody, as soon as it is known why, and all stops are on the wire."""
        error, who = self._why, self._cause
        if error is None or self._unstopped:
            return
        for name, axis in self._axes.items():
            cause = f"{axis.name}: its group has ended because of {who}: {error}"
            self.moves[name].tell(error if who in (None, name) else MoveCancelled(cause))
        self._tell_failed(who, error)


def _starts(frames: Mapping[DeviceAdapter, tuple[Bus, Request]]) -> dict[DeviceAdapter, float]:
    """When each device will start, in seconds after the first frame of the burst begins."""
    late: dict[DeviceAdapter, float] = {}
    for bus in {bus for bus, _ in frames.values()}:
        devices = [device for device, (its, _) in frames.items() if its is bus]
        late.update(zip(devices, bus.heard_after([frames[device][1] for device in devices]), strict=True))
    return late


async def _nothing(_: object) -> None:
    """They only meet."""
