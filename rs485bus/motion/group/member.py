"""A move that one axis makes together with others."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.motion.move import Move, MoveState, MoveTarget
from rs485bus.motion.parameters import MotionParameters, Tellable
from rs485bus.motion.profile import Profile
from rs485bus.wire.frames import Request


class Course(NamedTuple):
    """How fast one of those goes that start together, and when it starts."""

    pace: MotionParameters
    slot: BurstSlot


class GroupCoordinator(Protocol):
    """Those that move together. Each is known by its name."""

    async def meet(self, who: str) -> None:
        """Wait until all are as far as this one."""

    async def agree(self, who: str, turns: float, target: int) -> Course:
        """Wait until it is known of all how far they go, in turns; 0 for one that is there already."""

    async def all_arrived(self, who: str, within: float) -> bool:
        """This one has arrived. Wait some seconds until all have; whether they have."""

    def finished(self, who: str, position: float) -> None:
        """This one's part has ended well, there."""

    def stumbled(self, who: str) -> None:
        """This one's part is about to fail. The others are stopped while it is found out why."""

    def broken(self, who: str, error: Exception) -> None:
        """This one's part has failed. All are stopped, and each is told then (`GroupMemberMove.tell`)."""


class GroupMember(Tellable, Protocol):
    """An axis, as those see it that move with it."""

    bus: Bus
    name: str
    attached: DeviceAdapter
    accompany: Callable[[Mapping[GroupMember, GroupMemberMove]], None]
    """Called with all that start together, before they do."""

    @property
    def planned(self) -> float | None:
        """Where the queue will have taken it, in units, if that is known."""

    def goal_to(self, position: float) -> MoveTarget:
        """A position, in units, as somewhere to go. Raises `LimitExceeded`."""

    def goal_by(self, distance: float) -> MoveTarget:
        """A distance, in units, as somewhere to go. Raises `LimitExceeded`."""

    def way(self, start: float, end: float) -> float:
        """How many turns it is from one position, in units, to another; 0 where these are the same to the drive."""

    def join(self, goal: MoveTarget, who: str, coordinator: GroupCoordinator) -> GroupMemberMove:
        """Queue its part of a move that several make."""

    def start_frame(self, target: int, pace: MotionParameters) -> Request:
        """The frame that starts its part."""

    @property
    def condition(self) -> str:
        """How it was just now, in words: that it stood only where it was seen to."""

    def give_up(self, handle: Handle[Any], error: Exception) -> None:
        """End its part, and what is queued behind it."""

    def stop_if_moving(self) -> None:
        """Stop it, where it may move and is not being stopped already."""


@runtime_checkable
class GroupAxis(Protocol):
    """An axis, as it is given to a group."""

    bus: Bus
    name: str

    @property
    def member(self) -> GroupMember:
        """What its group tells it."""

    def check_ready(self) -> None:
        """Raise what keeps it from taking another command."""

    def forgive(self) -> None:
        """Take commands again after a failure that nobody has seen."""

    def enable(self) -> Handle[None]:
        """Energise its motor."""

    def disable(self) -> Handle[None]:
        """Let go of its shaft."""

    def stop(self) -> Handle[None]:
        """Stop it with its ramp."""

    def emergency_stop(self) -> Handle[None]:
        """Stop it as fast as its drive can."""

    async def position(self) -> float:
        """Where it is, in its units."""

    async def idle(self) -> bool:
        """Whether nothing is queued and it stands."""


class GroupMemberMove(Move):
    """One axis' part of a move that several make together.

    Where it fails, the others are stopped, and only then is anybody told.

    Args:
        what: names it in messages.
        target: where it goes, in the axis' units; None if that is not known yet.
        position: asks the axis where it is.
        cancel: stops the axis on behalf of this move.
        who: which axis it is, among the others.
        coordinator: the others.
    """

    def __init__(
        self,
        what: str,
        target: float | None,
        position: Callable[[], Awaitable[float]],
        cancel: Callable[[Move], None],
        who: str,
        coordinator: GroupCoordinator,
    ) -> None:
        super().__init__(what, target, position, cancel, lambda _: None)
        self.who = who
        self.profile: Profile | None = None
        """How it goes, as long as nobody changes that."""
        self._coordinator = coordinator

    def finish(self, result: float) -> None:
        super().finish(result)
        self._coordinator.finished(self.who, result)

    def fail(self, error: Exception) -> None:
        if not self.done():
            self._coordinator.broken(self.who, error)

    def tell(self, error: Exception) -> None:
        """Tell who waits that it has failed."""
        super().fail(error)

    # For the axis

    def stumble(self) -> None:
        """Have the others stopped: it is about to fail."""
        if self.state is not MoveState.QUEUED:
            self._coordinator.stumbled(self.who)

    async def gathered(self) -> None:
        """Wait until all have come to it, in their queues."""
        await self._coordinator.meet(self.who)

    async def prepared(self) -> None:
        """Wait until all stand, and may be moved."""
        await self._coordinator.meet(self.who)

    async def agree(self, turns: float, target: int) -> Course:
        """Wait until all know how far they go, and agree on how fast they do."""
        return await self._coordinator.agree(self.who, turns, target)

    async def all_arrived(self, within: float) -> bool:
        """Say that the axis has arrived; wait so many seconds until all have. Whether they have."""
        return await self._coordinator.all_arrived(self.who, within)

    async def ended(self) -> None:
        """Wait until it has ended for all: none begins its next command while another may still fail in this one."""
        await self._coordinator.meet(self.who)
