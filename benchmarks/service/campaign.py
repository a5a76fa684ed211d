"""Thousands of moves by three clients, who say things twice and lose their connections, while broker and service are
killed: each is done once or reported unknown."""

from __future__ import annotations

import asyncio
import contextlib
import random
import socket
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.service.drives import COUNTS, Drives, plant_file
from benchmarks.service.drives import running as running_drives
from benchmarks.service.mosquitto import Mosquitto
from benchmarks.service.processes import Served, serving
from rs485bus.errors import BusError, OutcomeUnknown
from rs485bus.remote import RemoteAxis, RemoteMove, RemotePlant, connect
from rs485bus.remote.requests import Pending

_BUSES, _DRIVES = 3, 4
_REACH = 12_000
"""Counts within which targets lie."""
_WAY = 200
"""Counts that a move goes at least."""
_KINDS = ("broker", "service")


@dataclass
class Verdict:
    """What was said, and what the drives were told."""

    said: Counter[str] = field(default_factory=Counter)
    """How many moves ended how."""
    doubled: list[tuple[str, int]] = field(default_factory=list)
    """Moves that a drive was told of twice, with others between them."""
    missing: list[tuple[str, int]] = field(default_factory=list)
    """Moves that were said to be done, of which no drive was told."""
    begun: list[tuple[str, int]] = field(default_factory=list)
    """Moves of which it was said that nothing was done, though a drive was told of them."""
    alien: list[tuple[str, int]] = field(default_factory=list)
    """Moves that nobody has commanded."""
    off: list[str] = field(default_factory=list)
    """Axes that are not where they should be at the end."""
    repeated: int = 0
    """Frames that the bus has said again."""
    messages: int = 0
    """How often a request was published."""
    drops: int = 0
    """How often a client has lost its connection."""
    kills: Counter[str] = field(default_factory=Counter)
    """How often the broker and the service were killed while moves went on."""
    asked: int = 0
    """Kills of each that were asked for."""

    @property
    def holds(self) -> bool:
        killed = all(self.kills[kind] == self.asked for kind in _KINDS)
        return killed and not (self.doubled or self.missing or self.begun or self.alien or self.off)

    def __str__(self) -> str:
        said = ", ".join(f"{count} {how}" for how, count in sorted(self.said.items()))
        killed = ", ".join(f"the {kind} killed {self.kills[kind]} times" for kind in _KINDS)
        return (
            f"{sum(self.said.values())} moves: {said}; published {self.messages} times; {self.drops} lost connections, "
            f"{killed}; doubled {len(self.doubled)}, done without a trace {len(self.missing)}, "
            f"refused but done {len(self.begun)}, alien {len(self.alien)}, not in place {self.off or 0}; "
            f"frames said again by the bus {self.repeated}"
        )


class Client:
    """One of those who command, with some axes of its own."""

    def __init__(self, plant: RemotePlant, axes: list[str], chance: random.Random, verdict: Verdict) -> None:
        self._plant = plant
        self._axes = axes
        self._random = chance
        self._verdict = verdict
        self.ends: dict[tuple[str, int], str] = {}
        """How each move ended, by axis and target in counts."""
        self.places: dict[str, int | None] = {}
        """Where each axis should be; None where that is not known."""
        self._recovering = asyncio.Lock()
        self._repeat_requests()

    async def move_all(self, count: int, progress: Callable[[], None]) -> None:
        """Make so many moves of each axis."""
        async with asyncio.TaskGroup() as group:
            dropping = group.create_task(self._drop_connections())
            async with asyncio.TaskGroup() as moving:
                for name in self._axes:
                    moving.create_task(self._move(self._plant.axes[name], count, progress))
            dropping.cancel()

    async def _move(self, axis: RemoteAxis, count: int, progress: Callable[[], None]) -> None:
        targets = self._random.sample(range(-_REACH, _REACH), count + count // 4)
        at = await self._recover(axis)
        for _ in range(count):
            target = next(target for target in targets if abs(target - at) >= _WAY)
            targets.remove(target)
            known = self.places.get(axis.name) == at
            if known and self._random.random() < 0.5:
                move = axis.move_by((target - at) / COUNTS)
            else:
                move = axis.move_to(target / COUNTS)
            how = await _ended(move)
            self.ends[axis.name, target] = how
            self._verdict.said[how] += 1
            progress()
            if how == "done":
                at = self.places[axis.name] = target
            else:
                self.places[axis.name] = None
                at = await self._recover(axis)

    async def _recover(self, axis: RemoteAxis) -> int:
        """Take control again, enable the motor, see where it is."""
        while True:
            try:
                async with self._recovering:
                    if axis.name not in self._plant.commanded:
                        await self._plant.take_control(*self._axes)
                await axis.enable()
                return round(await axis.position() * COUNTS)
            except BusError:
                await asyncio.sleep(0.2)

    def _repeat_requests(self) -> None:
        """Have requests published twice or thrice, at once or later."""
        session = self._plant.session
        send = session._send

        def again(pending: Pending) -> None:
            self._verdict.messages += 1
            send(pending)

        def send_often(pending: Pending) -> None:
            again(pending)
            while self._random.random() < 0.3:
                asyncio.get_running_loop().call_later(self._random.choice((0.0, 0.02, 0.5)), again, pending)

        session._send = send_often  # type: ignore[method-assign] # what a careless network does

    async def _drop_connections(self) -> None:
        while True:
            await asyncio.sleep(self._random.uniform(15, 45))
            mqtt = self._plant.session._mqtt
            connection = None if mqtt is None else mqtt._client.socket()
            if isinstance(connection, socket.socket):
                with contextlib.suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
                self._verdict.drops += 1


async def _ended(move: RemoteMove[float]) -> str:
    """How a move ended, by what was said of it."""
    with contextlib.suppress(BusError):
        await move
    if move.outcome:
        return move.outcome
    return "unknown" if isinstance(move.error, OutcomeUnknown) else "refused"


async def campaign(
    folder: Path, moves: int, kills: int, *, seed: int = 0, tell: Callable[[str], None] = print
) -> Verdict:
    """Make so many moves while broker and service are killed so many times each."""
    verdict = Verdict(asked=kills)
    broker = Mosquitto(folder)
    broker.start()
    try:
        async with running_drives(folder, _BUSES, _DRIVES) as drives:
            file = folder / "plant.toml"
            file.write_text(plant_file("cell", drives.ports, _DRIVES))
            async with (
                serving(file, broker.url, folder / "cell.sqlite") as served,
                _clients(broker.url, seed, verdict) as clients,
            ):
                each = -(-moves // (_BUSES * _DRIVES))
                await _move_while_killing(clients, each, verdict, broker, served, tell)
            await drives.end()
        _judge(verdict, clients, drives)
    finally:
        broker.stop()
    return verdict


@contextlib.asynccontextmanager
async def _clients(url: str, seed: int, verdict: Verdict) -> AsyncIterator[list[Client]]:
    async with contextlib.AsyncExitStack() as stack:
        clients = []
        for number in range(_BUSES):
            plant = await stack.enter_async_context(
                connect(url, plant="cell", client=f"client{number}", patience=60.0, lease=2.0)
            )
            # Each has an axis of each bus, and one more.
            axes = [name for at, name in enumerate(plant.axes) if at % _BUSES == number]
            clients.append(Client(plant, axes, random.Random(f"{seed} {number}"), verdict))
        yield clients


async def _move_while_killing(
    clients: list[Client], each: int, verdict: Verdict, broker: Mosquitto, served: Served, tell: Callable[[str], None]
) -> None:
    kills = verdict.asked
    total = each * _BUSES * _DRIVES
    done = 0
    changed = asyncio.Event()

    def progress() -> None:
        nonlocal done
        done += 1
        changed.set()
        if done % max(1, total // 20) == 0:
            tell(f"{done} of {total} moves")

    async def kill() -> None:
        restart: dict[str, Callable[[], Awaitable[None]]] = {"broker": restart_broker, "service": restart_service}
        for number in range(2 * kills):
            while done < total * (number + 1) / (2 * kills + 1):
                changed.clear()
                await changed.wait()
            kind = _KINDS[number % 2]
            await restart[kind]()
            verdict.kills[kind] += 1

    async def restart_broker() -> None:
        broker.kill()
        await asyncio.sleep(0.3)
        await asyncio.to_thread(broker.start)

    async def restart_service() -> None:
        await served.kill()
        await served.start()

    async with asyncio.TaskGroup() as group:
        killing = group.create_task(kill())
        async with asyncio.TaskGroup() as moving:
            for client in clients:
                moving.create_task(client.move_all(each, progress))
        killing.cancel()


def _judge(verdict: Verdict, clients: list[Client], drives: Drives) -> None:
    """Hold what was said against what the drives were told."""
    ends = {move: how for client in clients for move, how in client.ends.items()}
    last: dict[str, int] = {}
    told: set[tuple[str, int]] = set()
    for axis, target in drives.moves():
        move = (axis, target)
        if last.get(axis) == target:
            verdict.repeated += 1
        elif move in told:
            verdict.doubled.append(move)
        elif move not in ends:
            verdict.alien.append(move)
        elif ends[move] == "refused":
            verdict.begun.append(move)
        told.add(move)
        last[axis] = target
    verdict.missing = [move for move, how in ends.items() if how == "done" and move not in told]
    for client in clients:
        for axis, place in client.places.items():
            if place is not None and drives.positions[axis] != place:
                verdict.off.append(f"{axis} at {drives.positions[axis]} instead of {place}")
