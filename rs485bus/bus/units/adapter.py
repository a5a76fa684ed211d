"""What the owner must know of a device on its bus: how it stops, is confirmed, is fed, what it hears of broadcasts.

Each family implements this once. It is pure: requests and replies, no waiting.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

from rs485bus.bus.units.motion import Motion
from rs485bus.wire.answers import READ_WRITE, WRITE_MULTIPLE, WRITE_SINGLE
from rs485bus.wire.frames import Request

_log = logging.getLogger("rs485bus")


class StandstillDetector(ABC):
    """Decides from what a device reports whether it stands. Made anew for every stop that is not a repetition."""

    by_status_alone = False
    """It was said to stand by its status, which has been seen to lie. That will do where the stop was acknowledged,
    and more cannot be seen in time. Else it is asked on, until its position shows it."""
    by_position_alone = False
    """It was seen to stand by its position, and its status does not say so: it may push against what holds it. That
    will do where the stop was acknowledged."""
    lacks_place = False
    """Its status says that it stands, and where that is was not asked yet; or its last answer told neither: there is
    nothing to wait for."""
    slows_down = False
    """It was slower when it was asked last than when it was asked before that."""

    def stop_sent(self) -> None:
        """It was told to stop, perhaps once more: what tells soonest is asked first."""
        return

    @abstractmethod
    def ask(self, free: Callable[[Request], bool]) -> Request | None:
        """The next read that helps to decide, one for which `free` holds: a late reply cannot be taken for its
        answer. None if all must wait."""

    @abstractmethod
    def see(self, request: Request, reply: bytes, sent_at: float) -> bool | None:
        """Take in an answer to such a read, sent at the time given (seconds).

        True: it stands. False: it moves. None: ask again.
        """


class WatchdogRegister(ABC):
    """The watchdog register of a device."""

    register: int
    """Its address."""
    count: int = 1
    """How many registers it takes."""
    off: int = 0
    """The value, in milliseconds, that turns it off."""
    highest: int
    """The longest time it can be set to, in milliseconds."""

    @abstractmethod
    def write(self, milliseconds: int) -> Request:
        """Set the time."""

    def read(self) -> Request | None:
        """Read the time back; None where the device cannot be asked."""
        return None

    def decode(self, reply: bytes) -> int:
        """The milliseconds in such a reply."""
        raise NotImplementedError  # who cannot be asked has no replies

    def set_by(self, request: Request) -> int | None:
        """The milliseconds that a request would set it to; None if it would not."""
        if request.function == WRITE_SINGLE:
            first, data = request.register, request.adu[4:6]
        elif request.function == WRITE_MULTIPLE:
            first, data = request.register, request.adu[7:-2]
        elif request.function == READ_WRITE:
            first, data = int.from_bytes(request.adu[6:8], "big"), request.adu[11:-2]
        else:
            return None
        at, size = 2 * (self.register - first), 2 * self.count
        return int.from_bytes(data[at : at + size], "big") if 0 <= at <= len(data) - size else None


class DeviceAdapter(ABC):
    """A device, as its bus knows it."""

    address: int
    family: str
    motion: Motion
    """All of it. What a frame may set in motion, and a stop ends."""
    late_reply_window: float | None = None
    """Seconds; None for what the bus is set to."""
    reply_timeout: float | None = None
    """Seconds; None for what the bus is set to."""
    start_grace: float = 0.05
    """Seconds after a frame that moves it, within which it may report that it stands and yet start."""
    when_silent: str = ""
    """What else to look at where it has never answered."""
    watchdog: WatchdogRegister | None = None
    read_function: int | None = None
    """The only function that reads its registers, if it has but one."""
    refusals: Mapping[int, str] = MappingProxyType({})
    """What exception codes mean to it, where it gives them a meaning of its own."""
    combines_reads: bool = True
    """Whether neighbouring registers may be read with one request."""
    longest: int = 51
    """Bytes, request and reply together, of the longest request that its facade makes but for those that disrupt."""

    goes_by_known_stops = False
    """The latest stop of it could not be made: it was told what was known to stop it."""

    @abstractmethod
    def reads(self) -> Sequence[Request]:
        """Reads without side effects, the most telling first, each with a reply of another length."""

    @abstractmethod
    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        """The frames that stop it, or the part of it named: as fast as it can, or with its ramp."""

    def known_stops(self, motion: Motion) -> Sequence[Request]:
        """Frames known from before that stop it, or the part of it named, if with its ramp only; empty for none."""
        return ()

    def stop_frames(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        """What it is told to stop: `stops`, or what is known from before where the family's own code fails in that."""
        try:
            frames = self.stops(motion, emergency)
        except Exception:
            known = self.known_stops(motion)
            if not known:
                raise
            if not self.goes_by_known_stops:
                _log.exception("unit %d is stopped as it was to be when it started: stops failed", self.address)
            self.goes_by_known_stops = True
            return known
        self.goes_by_known_stops = False
        return frames

    @abstractmethod
    def stopping_time(self, emergency: bool) -> float:
        """Seconds that may pass between a stop frame and standing."""

    @abstractmethod
    def judgement(self, motion: Motion) -> StandstillDetector:
        """A new judge of whether it, or the part of it named, stands."""

    def may_start_until(self, motion: Motion) -> float:
        """Until when what was sent last to a part of it may set that in motion, though it reports that it stands."""
        return motion.commanded_at + self.start_grace

    @abstractmethod
    def hears(self, request: Request) -> bool:
        """Whether it would act on this request if it were broadcast."""

    def may_be_moved_by(self, request: Request) -> bool:
        """Whether a write, whoever makes it, may set it in motion. Asked where that is not known otherwise."""
        return True

    def does_nothing(self, request: Request, code: int) -> bool:
        """Whether it has done nothing when it answers a write by this exception.

        Asked of the exceptions with which other devices may have begun it, or done it: 04, 05, 07, 08, unknown ones.
        """
        return False

    def disrupts(self, request: Request) -> bool:
        """Whether it would be slow to answer this request, or not answer for a while afterwards (it restarts, say).

        Such requests are refused while a watchdog on the bus is armed.
        """
        return False

    def explain(self, heard: bytes) -> str:
        """What bytes mean that such a device may send and that are no answer; empty if it sends none such."""
        return ""

    def broadcast_stop(self) -> Request | None:
        """The broadcast that stops every device of this family at once, if it listens to one."""
        return None

    @abstractmethod
    def on_reply(self, request: Request, reply: bytes, asked_at: float, now: float) -> None:
        """It has answered, whoever asked. `asked_at` is the earliest time at which this reply can have been asked for:
        one that may have come late is that old. Refusals and exceptions are not told."""

    def on_unanswered(self, sent_at: float) -> None:
        """It has not answered a request in its time, whoever asked."""
        return

    def on_busy(self) -> None:
        """It has answered, whoever asked, that it is busy, or at it still."""
        return

    def on_late_reply(self, sent_at: float) -> None:
        """A reply came too late for whoever asked, to what was sent then at the latest. It is told to nobody else."""
        return

    def on_sent(self, request: Request, at: float) -> None:
        """A write to it goes out, whoever sends it, or a broadcast that it hears."""
        return

    @abstractmethod
    def interrupted(self, unheard: float, reason: str) -> None:
        """The bus stopped it for safety, or lost it: its watchdog may have tripped, the port was lost. It had been
        unheard for so many seconds."""


class BusMember(Protocol):
    """A facade on the bus, as what ends its moves sees it: closing, or the end of a watchdog block."""

    attached: DeviceAdapter

    async def drain(self) -> None:
        """Wait until nothing is queued or moving."""

    def abandon(self, why: str) -> None:
        """End everything that is queued."""


def abandon(members: Iterable[BusMember], why: str) -> None:
    """Have facades end what is queued on them. One that fails in that keeps nobody from what follows."""
    for member in members:
        try:
            member.abandon(why)
        except Exception:
            _log.exception("%s %d could not end what was queued", member.attached.family, member.attached.address)
