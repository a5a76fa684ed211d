"""An axis, a group and a vehicle of a served plant: the verbs of `rs485bus`, said over the broker."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from typing import Any

from rs485bus.arguments import real
from rs485bus.bus.handle import Handle, start_task
from rs485bus.remote.handles import RemoteMove
from rs485bus.remote.outbox import Outbox
from rs485bus.remote.session import Session
from rs485bus.remote.stream import RemoteStream
from rs485bus.service.schema import AxisEvent, AxisFacts, AxisReport

_KEPT = 256
"""Events and samples that wait for a listener; of more the oldest are dropped."""
_ASKED_FOR = 10.0
"""Seconds for which samples are asked for at a time."""


class Remote:
    """Something of a plant that can be told to move.

    Args:
        name: what it is called.
        axes: what it moves.
        session: the connection.
        outbox: says the verbs.
    """

    def __init__(self, name: str, axes: frozenset[str], session: Session, outbox: Outbox) -> None:
        self.name = name
        self.moves = axes
        """The names of the axes that it moves."""
        self._session = session
        self._outbox = outbox

    def __repr__(self) -> str:
        return f"<{self.name} of {self._session.topics.plant}>"

    def stop(self) -> Handle[list[str]]:
        """Stop with the ramp, and see it stand. It needs no control, and overtakes everything.

        Raises:
            StopUnconfirmed: when it is awaited: it was not seen to stand.
        """
        return self._outbox.stop(self.moves, everything=False)

    def emergency_stop(self) -> Handle[list[str]]:
        """Stop as fast as the drives can, and see them stand. It needs no control, and overtakes everything."""
        return self._outbox.stop(self.moves, everything=False, emergency=True)

    def _verb(
        self, verb: str, where: Callable[[], Handle[float]] | None = None, /, **arguments: Any
    ) -> RemoteMove[Any]:
        return self._outbox.verb(self.name, verb, arguments, self.moves, position=where)

    def _question(self, question: str, **arguments: Any) -> Handle[Any]:
        return self._session.ask(self.name, question, arguments, f"{question} of {self.name}")


class RemoteAxis(Remote):
    """One axis. Its verbs act when they are called, and return a handle, as those of an axis in this program."""

    @property
    def facts(self) -> AxisFacts:
        """What does not change: its family, units, usual speed and acceleration, limits."""
        assert self._session.plant is not None
        return self._session.plant.axes[self.name]

    @property
    def report(self) -> AxisReport | None:
        """What the service said of it last. `at` is the service's clock."""
        return self._session.reports.get(self.name)

    def enable(self) -> RemoteMove[None]:
        """As `Axis.enable`."""
        return self._verb("enable")

    def disable(self) -> RemoteMove[None]:
        """As `Axis.disable`."""
        return self._verb("disable")

    def move_to(
        self, position: float, *, rpm: float | None = None, acceleration: float | None = None
    ) -> RemoteMove[float]:
        """As `Axis.move_to`. What is out of range is raised when it is awaited."""
        return self._verb("move_to", self.position, position=_number("position", position), **_pace(rpm, acceleration))

    def move_by(
        self, distance: float, *, rpm: float | None = None, acceleration: float | None = None
    ) -> RemoteMove[float]:
        """As `Axis.move_by`. What is out of range is raised when it is awaited."""
        return self._verb("move_by", self.position, distance=_number("distance", distance), **_pace(rpm, acceleration))

    def run(self, rpm: float, *, acceleration: float | None = None, duration: float | None = None) -> RemoteMove[float]:
        """As `Axis.run`. Without a `duration` it turns until it is told otherwise, or control ends."""
        return self._verb("run", self.position, duration=duration, **_pace(_number("rpm", rpm), acceleration))

    def home(self) -> RemoteMove[float]:
        """As the family's `home`, in the way in which the drive is set up for it."""
        return self._verb("home", self.position)

    def set_zero(self) -> RemoteMove[None]:
        """As `Axis.set_zero`."""
        return self._verb("set_zero")

    def stream(self, timeout: float = 0.25) -> RemoteStream:
        """As `Axis.stream`: `async with axis.stream() as setpoint: setpoint(rpm)`.

        A set-point holds for `timeout` seconds after it was given here: its way over the network counts.
        """
        return RemoteStream(self.name, self.moves, self._session, self._outbox, timeout, values=1)

    def position(self) -> Handle[float]:
        """Where it is, in its units: its drive is asked."""
        return self._question("position")

    def velocity(self) -> Handle[float]:
        """How fast the motor turns, in rpm: its drive is asked."""
        return self._question("velocity")

    def idle(self) -> Handle[bool]:
        """Whether nothing is queued and the motor stands."""
        return self._question("idle")

    def status(self) -> Handle[dict[str, Any]]:
        """What the drive reports, in the family's terms, as names and values."""
        return self._question("status")

    async def samples(self, every: float = 0.05) -> AsyncIterator[AxisReport]:
        """What is known of it, about every so many seconds. A sample that does not come in time is left out.

        Args:
            every: seconds, from 0.01 on.
        """
        waiting: asyncio.Queue[AxisReport] = asyncio.Queue(_KEPT)
        last: AxisReport | None = None

        def take(name: str, report: AxisReport) -> None:
            nonlocal last
            if name == self.name and (last is None or report.at > last.at):  # one may come as a sample and as a state
                last = report
                _put(waiting, report)

        asking = start_task(self._ask_for_samples(every))
        self._session.on_report.append(take)
        try:
            while True:
                yield await waiting.get()
        finally:
            self._session.on_report.remove(take)
            asking.cancel()

    async def events(self) -> AsyncIterator[AxisEvent]:
        """What happens to it, from now on."""
        waiting: asyncio.Queue[AxisEvent] = asyncio.Queue(_KEPT)

        def take(event: AxisEvent) -> None:
            if event.axis == self.name:
                _put(waiting, event)

        self._session.on_event.append(take)
        try:
            while True:
                yield await waiting.get()
        finally:
            self._session.on_event.remove(take)

    async def _ask_for_samples(self, every: float) -> None:
        while True:
            self._question("sample", every=every, seconds=_ASKED_FOR)
            await asyncio.sleep(_ASKED_FOR / 2)


class RemoteGroup(Remote):
    """Axes of one plant that move together, as an `AxisGroup`."""

    def move_to(
        self, *, duration: float | None = None, rpm: float | None = None, **positions: float
    ) -> RemoteMove[dict[str, float]]:
        """As `AxisGroup.move_to`: they start and arrive together."""
        return self._verb("move_to", None, places=_places(positions), duration=duration, rpm=rpm)

    def move_by(
        self, *, duration: float | None = None, rpm: float | None = None, **distances: float
    ) -> RemoteMove[dict[str, float]]:
        """As `AxisGroup.move_by`."""
        return self._verb("move_by", None, places=_places(distances), duration=duration, rpm=rpm)

    def home(self) -> RemoteMove[dict[str, float]]:
        """As `AxisGroup.home`."""
        return self._verb("home")

    def enable(self) -> RemoteMove[None]:
        """As `AxisGroup.enable`."""
        return self._verb("enable")

    def disable(self) -> RemoteMove[None]:
        """As `AxisGroup.disable`."""
        return self._verb("disable")

    def positions(self) -> Handle[dict[str, float]]:
        """Where each axis is, in its units."""
        return self._question("positions")


class RemoteVehicle(Remote):
    """The vehicle of a plant, as a `DifferentialDrive`."""

    def drive(self, v: float, omega: float) -> RemoteMove[list[float]]:
        """As `DifferentialDrive.drive`: m/s ahead, and rad/s."""
        return self._verb("drive", v=_number("v", v), omega=_number("omega", omega))

    def stream(self, timeout: float = 0.25) -> RemoteStream:
        """As `DifferentialDrive.stream`: `setpoint(v, omega)`."""
        return RemoteStream(self.name, self.moves, self._session, self._outbox, timeout, values=2)


def _number(name: str, value: float) -> float:
    number = real(name, value)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be a finite number, not {value!r}")
    return number


def _pace(rpm: float | None, acceleration: float | None) -> dict[str, float | str | None]:
    """Speed and acceleration as JSON has them, which knows no infinite numbers."""
    return {
        "rpm": None if rpm is None else _number("rpm", rpm),
        "acceleration": "Infinity" if acceleration == math.inf else acceleration,
    }


def _places(places: dict[str, float]) -> dict[str, float]:
    return {name: _number(name, place) for name, place in places.items()}


def _put(queue: asyncio.Queue[Any], item: Any) -> None:
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(item)
