"""A served plant, as a client sees it."""

from __future__ import annotations

import asyncio
import os
import re
import secrets
import socket
from collections.abc import Generator, Mapping
from types import TracebackType
from typing import Any, Literal

from rs485bus.arguments import positive
from rs485bus.bus.async_block import AsyncBlock
from rs485bus.bus.handle import Handle
from rs485bus.errors import BusError
from rs485bus.remote.axis import RemoteAxis, RemoteGroup, RemoteVehicle
from rs485bus.remote.control import Control
from rs485bus.remote.handles import RemoteMove
from rs485bus.remote.outbox import Outbox
from rs485bus.remote.session import Session
from rs485bus.service.broker import DEFAULT, Broker
from rs485bus.service.schema import BusReport, Description
from rs485bus.service.topics import PLANT, PREFIX, VEHICLE, Topics, level


class RemotePlant(AsyncBlock):
    """The axes, groups and the vehicle of a served plant, by their names. Made by `connect`."""

    def __init__(self, session: Session, lease: float, life: float) -> None:
        assert session.plant is not None
        self._session = session
        self._control = Control(session, lease)
        self._outbox = Outbox(session, self._control, life)
        plant = session.plant
        self.axes: Mapping[str, RemoteAxis] = {
            name: RemoteAxis(name, frozenset({name}), session, self._outbox) for name in plant.axes
        }
        self.groups: Mapping[str, RemoteGroup] = {
            name: RemoteGroup(name, frozenset(axes), session, self._outbox) for name, axes in plant.groups.items()
        }
        wheels = plant.vehicles.get(VEHICLE)
        self.vehicle = None if wheels is None else RemoteVehicle(VEHICLE, frozenset(wheels), session, self._outbox)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self.axes:
            return self.axes[name]
        if name in self.groups:
            return self.groups[name]
        there = ", ".join((*self.axes, *self.groups))
        raise AttributeError(f"the plant {self.name} has no axis and no group {name!r}: {there}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.axes, *self.groups]

    def __repr__(self) -> str:
        return f"<plant {self.name} at {self._session.broker}: {', '.join(self.axes)}>"

    @property
    def name(self) -> str:
        """What it is called."""
        return self._session.topics.plant

    @property
    def session(self) -> Session:
        """The connection."""
        return self._session

    @property
    def description(self) -> Description:
        """What the service says of itself and of the plant."""
        assert self._session.plant is not None
        return self._session.plant

    @property
    def buses(self) -> Mapping[str, BusReport]:
        """Load and errors of each bus, as the service said them last."""
        return self._session.buses

    @property
    def control_lost(self) -> str:
        """Why control was lost; empty while it was not."""
        return self._control.lost

    @property
    def commanded(self) -> frozenset[str]:
        """The axes that this client commands now."""
        return self._control.axes

    async def take_control(self, *names: str) -> None:
        """Command axes, groups or the vehicle; all axes where none is named. A verb does that by itself for what it
        moves, but not after control was lost.

        Raises:
            NotInControl: another client commands one of them.
        """
        await self._control.take(names or self.axes)

    async def cover(self, *names: str) -> None:
        """Command these axes besides others. Raises as a verb of theirs would."""
        await self._control.cover(names)

    def clock_offset(self) -> tuple[float, float]:
        """How far the service's clock is ahead of this event loop's, in seconds; and by how much that may be wrong."""
        return self._session.clock.offset(asyncio.get_running_loop().time())

    async def release_control(self) -> None:
        """Command nothing any more. What still moves is stopped, and seen to stand."""
        await self._control.release()

    def move_to(
        self, *, duration: float | None = None, rpm: float | None = None, at: float | None = None, **positions: float
    ) -> RemoteMove[dict[str, float]]:
        """Send axes of the plant to positions, together, as `AxisGroup.move_to`.

        Args:
            duration: seconds.
            rpm: the highest speed of any of them.
            at: when to start, by the service's clock, within 50 s; None for at once.
            positions: where to go, by the names of axes.
        """
        return self._together("move_to", positions, duration, rpm, at)

    def move_by(
        self, *, duration: float | None = None, rpm: float | None = None, at: float | None = None, **distances: float
    ) -> RemoteMove[dict[str, float]]:
        """Send axes of the plant a distance each. Arguments as for `move_to`."""
        return self._together("move_by", distances, duration, rpm, at)

    def stop(self) -> Handle[list[str]]:
        """Stop all axes with their ramps, and see them stand. It needs no control, and overtakes everything."""
        return self._outbox.stop(frozenset(self.axes), everything=True)

    def emergency_stop(self) -> Handle[list[str]]:
        """Stop all axes as fast as they can, and let nothing move until `clear_emergency_stop()`. It needs no control,
        and overtakes everything."""
        return self._outbox.stop(frozenset(self.axes), everything=True, emergency=True)

    def clear_emergency_stop(self) -> RemoteMove[None]:
        """Allow motion again. Each axis then needs `enable()`."""
        return self._outbox.verb(PLANT, "clear_emergency_stop", {}, frozenset(self.axes), covered=frozenset())

    async def drain(self) -> None:
        """Wait until all that was said has ended."""
        await self._outbox.drain()

    def failures(self) -> list[Exception]:
        """What failed and was seen by nobody."""
        return self._outbox.failures()

    async def close(self, *, stop: bool = False) -> None:
        """Give control back, and close the connection; with `stop`, stop what is commanded before. It is bounded."""
        held = self._control.axes
        self._outbox.close()
        try:
            if self._session.connected.is_set():
                if stop and held:
                    await self._outbox.stop(held, everything=False).wait()
                await self._control.release()
        finally:
            self._control.close()
            await self._session.close()

    def _together(
        self, verb: str, places: dict[str, float], duration: float | None, rpm: float | None, at: float | None
    ) -> RemoteMove[dict[str, float]]:
        arguments = {"places": places, "duration": duration, "rpm": rpm}
        return self._outbox.verb(PLANT, verb, arguments, frozenset(places), at=at)


def connect(
    broker: str | Broker = DEFAULT,
    *,
    plant: str,
    lease: float = 1.0,
    client: str | None = None,
    prefix: str = PREFIX,
    patience: float = 10.0,
    life: float = 2.0,
    username: str | None = None,
    password: str | None = None,
    ca: str | None = None,
    certificate: str | None = None,
    key: str | None = None,
) -> Connecting:
    """Use a plant that is served at a broker: `async with connect("mqtt://host", plant="cell") as plant`.

    A verb takes control of what it moves, if nobody else has it. A block that ends well waits for what was said, then
    gives control back; one left by an exception stops first.

    Args:
        broker: "mqtt://host", "mqtts://user:password@host:8883".
        plant: its name.
        lease: seconds that this client may be silent while it commands something, 0.1..60. Then its axes are stopped.
        client: its name, which no other client has; None for one that is made up.
        prefix: what the topics begin with.
        patience: seconds within which something must be heard of what was said.
        life: seconds within which a verb must be begun, or is refused.
        username: as whom; the address may say it, too.
        password: of the user.
        ca: the file with the certificate of who signs for the broker.
        certificate: the file with the client's own certificate.
        key: the file with its key.

    Raises:
        ValueError: an argument out of its range, or no address of a broker.
        BrokerError: when the block is entered: why there is no connection, or no such plant.
    """
    if not isinstance(broker, Broker):
        broker = Broker.at(broker, username=username, password=password, ca=ca, certificate=certificate, key=key)
    if not 0.1 <= positive("lease (s)", lease) <= 60:
        raise ValueError(f"lease {lease:g} s is outside 0.1..60")
    if not 0.05 <= positive("life (s)", life) <= 60:
        raise ValueError(f"life {life:g} s is outside 0.05..60")
    name = level("client", client) if client is not None else _made_up()
    return Connecting(broker, Topics(plant, prefix), name, lease, life, positive("patience (s)", patience))


class Connecting:
    """What `connect` returns: an async context manager, or to be awaited for a plant to be closed with `close()`."""

    def __init__(self, broker: Broker, topics: Topics, client: str, lease: float, life: float, patience: float) -> None:
        self._broker = broker
        self._topics = topics
        self._client = client
        self._lease = lease
        self._life = life
        self._patience = patience
        self._plant: RemotePlant | None = None

    async def open(self) -> RemotePlant:
        """Connect. Raises as said at `connect`."""
        session = Session(self._broker, self._topics, self._client, self._patience)
        await session.open()
        return RemotePlant(session, self._lease, self._life)

    def __await__(self) -> Generator[Any, None, RemotePlant]:
        return self.open().__await__()

    async def __aenter__(self) -> RemotePlant:
        self._plant = await self.open()
        return self._plant

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        plant = self._plant
        assert plant is not None
        if error is None:
            try:
                await plant.drain()
            finally:
                await plant.close()
            failures = plant.failures()
            if failures:
                raise ExceptionGroup("commands failed that nobody awaited", failures)
            return False
        try:
            await asyncio.shield(plant.close(stop=True))
        except BusError as failed:
            error.add_note(f"The axes could not be stopped from here: {failed!r}. The lease ends by itself.")
        for failure in plant.failures():
            if failure is not error:
                error.add_note(f"Nobody awaited a command that failed: {failure!r}")
        return False


def _made_up() -> str:
    host = re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname())[:24]
    return f"{host}-{os.getpid()}-{secrets.token_hex(3)}"
