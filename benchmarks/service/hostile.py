"""Clients that keep to no rule: wrong clocks, wrong leases, retained commands, the same thing said in every way, two of
one name, garbage on every topic, and stops, while service and broker are ended: each move is done once or not at all,
whoever is told an end is told one, and that is so."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import time
from collections import Counter, defaultdict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from benchmarks.service.drives import COUNTS, Drives, plant_file
from benchmarks.service.drives import running as running_drives
from benchmarks.service.mosquitto import Mosquitto
from benchmarks.service.processes import Served, serving

_NAMES = ("a", "b", "c", "c")
_AXES = ("a00", "a01")
_ROOT = "rs485bus/cell"
_BUTTONS = ("stop",) * 20 + ("emergency_stop",)
_GARBAGE = (b"", b"{}", b"[" * 9_000, b'{"v": 1}', b"\xff\xfe", b" " * 100_000)
_ANYWHERE = ("service", "axis/a00/state", "request/a00/move_to", "request/a00/move_to/more", "setpoint/a00", "gone/b")


@dataclass
class Verdict:
    """What was told, and what the drives were told."""

    said: Counter[str] = field(default_factory=Counter)
    """How many moves ended how; "" for those of which nothing was heard."""
    doubled: list[tuple[str, int]] = field(default_factory=list)
    untrue: list[str] = field(default_factory=list)
    """What was told that is not so."""
    moving: list[str] = field(default_factory=list)
    """Axes that turn at the end, when nobody commands them."""

    @property
    def holds(self) -> bool:
        return self.said["done"] > 0 and not (self.doubled or self.untrue or self.moving)

    def __str__(self) -> str:
        said = ", ".join(f"{count} {how or 'without an answer'}" for how, count in sorted(self.said.items()))
        return (
            f"{sum(self.said.values())} moves of hostile clients: {said}; doubled {self.doubled or 0}, "
            f"untrue {self.untrue or 0}, turning at the end {self.moving or 0}"
        )


class Hostile:
    """One client, or another one of the same name."""

    def __init__(self, name: str, port: int, chance: random.Random, targets: Callable[[], int]) -> None:
        self.moves: dict[str, tuple[str, int]] = {}
        """Of each request where to, in counts."""
        self.ends: dict[str, list[dict[str, Any]]] = defaultdict(list)
        self._name = name
        self._port = port
        self._random = chance
        self._target = targets
        self._lease = 1

    async def run(self, until: float) -> None:
        """Come, act, and leave without a word."""
        while time.monotonic() < until:
            with contextlib.suppress(aiomqtt.MqttError, OSError):
                async with self._connection() as mqtt:
                    await mqtt.subscribe(f"{_ROOT}/reply/{self._name}", qos=self._random.choice((0, 1, 2)))
                    listening = asyncio.create_task(self._listen(mqtt))
                    try:
                        await self._act(mqtt, min(until, time.monotonic() + self._random.uniform(1, 10)))
                    finally:
                        listening.cancel()
            await asyncio.sleep(self._random.uniform(0, 0.5))

    def _connection(self) -> aiomqtt.Client:
        properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call] # paho has no types here
        properties.SessionExpiryInterval = 30
        return aiomqtt.Client(
            "127.0.0.1",
            self._port,
            identifier=self._name,
            protocol=aiomqtt.ProtocolVersion.V5,
            clean_start=self._random.random() < 0.5,
            properties=properties,
            timeout=5,
        )

    async def _listen(self, mqtt: aiomqtt.Client) -> None:
        with contextlib.suppress(aiomqtt.MqttError):
            async for message in mqtt.messages:
                assert isinstance(message.payload, bytes)
                told = json.loads(message.payload)
                if told["outcome"] != "begun":
                    self.ends[told["id"]].append(told)
                if isinstance(told.get("value"), dict):
                    self._lease = told["value"].get("lease", self._lease)

    async def _act(self, mqtt: aiomqtt.Client, until: float) -> None:
        acts: list[tuple[int, Callable[[aiomqtt.Client], Awaitable[None]]]] = [
            (15, self._take_control),
            (20, self._show_presence),
            (10, self._enable),
            (40, self._move),
            (4, self._stop),
            (3, self._ask),
            (3, self._clear),
            (3, self._babble),
        ]
        while time.monotonic() < until:
            (act,) = self._random.choices([act for _, act in acts], [weight for weight, _ in acts])
            await act(mqtt)
            await asyncio.sleep(self._random.choice((0, 0.01, 0.05, 0.2)))

    # What it does

    async def _take_control(self, mqtt: aiomqtt.Client) -> None:
        axes = self._random.choice((_AXES, _AXES[:1], _AXES[1:]))
        lease = self._lease if self._random.random() < 0.5 else None
        wanted = {"axes": axes, "seconds": self._random.choice((0.3, 3.0, 9.0))}
        await self._say(mqtt, "request/plant/take_control", self._request(lease=lease, args=wanted))

    async def _show_presence(self, mqtt: aiomqtt.Client) -> None:
        said = self._request(lease=self._lease)
        del said["expires"]
        await self._say(mqtt, f"presence/{self._name}", said)

    async def _enable(self, mqtt: aiomqtt.Client) -> None:
        await self._say(mqtt, f"request/{self._random.choice(_AXES)}/enable", self._request(lease=self._lease))

    async def _move(self, mqtt: aiomqtt.Client) -> None:
        axis, target = self._random.choice(_AXES), self._target()
        said = self._request(lease=self._random.choice((*[self._lease] * 9, 12345)), args={"position": target / COUNTS})
        if self._random.random() < 0.1:
            said["at"] = said["sent"] + 0.2
        self.moves[said["id"]] = axis, target
        for _ in range(self._random.choice((1, 1, 1, 2, 4))):
            await self._say(mqtt, f"request/{axis}/move_to", said, retain=self._random.random() < 0.05)
            await asyncio.sleep(self._random.choice((0, 0, 0, 0.05, 0.4)))

    async def _stop(self, mqtt: aiomqtt.Client) -> None:
        said = {"v": 1, "id": self._id(), "client": self._name, "axes": self._random.choice((None, _AXES[:1], ["no"]))}
        payload = self._random.choice((said, said, b"", b"\xff"))
        await self._say(mqtt, self._random.choice(_BUTTONS), payload, retain=self._random.random() < 0.1)

    async def _clear(self, mqtt: aiomqtt.Client) -> None:
        await self._say(mqtt, "request/plant/clear_emergency_stop", self._request(lease=self._lease))

    async def _ask(self, mqtt: aiomqtt.Client) -> None:
        await self._say(mqtt, f"request/{self._random.choice(_AXES)}/position", self._request())

    async def _babble(self, mqtt: aiomqtt.Client) -> None:
        retain = self._random.random() < 0.5
        await self._say(mqtt, self._random.choice(_ANYWHERE), self._random.choice(_GARBAGE), retain=retain)

    # How it says so

    def _id(self) -> str:
        return f"{self._name}-{self._random.getrandbits(60)}"

    def _request(self, **fields: Any) -> dict[str, Any]:
        """One whose clock may be wrong."""
        sent = time.time() - self._random.choice((*[0.002] * 8, 0.5, -0.02, -1.0))
        life = self._random.choice((0.3, 2.0, 30.0))
        return {"v": 1, "id": self._id(), "client": self._name, "sent": sent, "expires": sent + life, **fields}

    async def _say(
        self, mqtt: aiomqtt.Client, topic: str, said: dict[str, Any] | bytes, *, retain: bool = False
    ) -> None:
        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call] # paho has no types here
        properties.ResponseTopic = f"{_ROOT}/reply/{self._name}"
        properties.CorrelationData = self._random.randbytes(4)
        payload = said if isinstance(said, bytes) else json.dumps(said).encode()
        qos = self._random.choice((0, 1, 2))
        await mqtt.publish(f"{_ROOT}/{topic}", payload, qos=qos, retain=retain, properties=properties)


async def attack(folder: Path, seconds: float, seed: int) -> Verdict:
    """Let them, for so many seconds."""
    chance = random.Random(seed)
    targets = iter(chance.sample(range(-12_000, 12_000), 24_000))
    broker = Mosquitto(folder)
    broker.start()
    try:
        async with running_drives(folder, 1, len(_AXES)) as drives:
            file = folder / "plant.toml"
            file.write_text(plant_file("cell", drives.ports, len(_AXES)))
            async with serving(file, broker.url, folder / "cell.sqlite") as served:
                clients = [Hostile(name, broker.port, chance, lambda: next(targets)) for name in _NAMES]
                until = time.monotonic() + seconds
                ending = asyncio.create_task(_end_now_and_then(served, broker, chance))
                await asyncio.gather(*(client.run(until) for client in clients))
                ending.cancel()
                await asyncio.gather(ending, return_exceptions=True)
            await drives.end()
        return _judge(clients, drives)
    finally:
        broker.stop()


async def _end_now_and_then(served: Served, broker: Mosquitto, chance: random.Random) -> None:
    while True:
        await asyncio.sleep(chance.uniform(8, 15))
        broker.kill()
        await asyncio.sleep(0.3)
        await asyncio.to_thread(broker.start)
        await asyncio.sleep(chance.uniform(8, 15))
        await served.kill()
        await served.start()


def _judge(clients: list[Hostile], drives: Drives) -> Verdict:
    verdict = Verdict(moving=drives.turning)
    told: set[tuple[str, int]] = set()
    last: dict[str, int] = {}
    for move in drives.moves():
        axis, target = move
        if last.get(axis) != target and move in told:  # what the bus says again follows at once
            verdict.doubled.append(move)
        told.add(move)
        last[axis] = target
    for client in clients:
        for request, move in client.moves.items():
            ends = {end["outcome"] for end in client.ends[request]}
            verdict.said[" and ".join(sorted(ends))] += 1
            if len(ends) > 1 or (ends == {"refused"} and move in told) or (ends == {"done"} and move not in told):
                verdict.untrue.append(f"{request}: {client.ends[request]}")
    return verdict
