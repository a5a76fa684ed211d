"""A client is killed, its network is cut, the broker is killed or cut off, in the middle of a move, a run and a stream:
how long until the axis stands."""

from __future__ import annotations

import asyncio
import contextlib
import os
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.service.mosquitto import Mosquitto
from rs485bus.plant import Plant
from rs485bus.service.broker import Broker
from rs485bus.service.ledger import Ledger
from rs485bus.service.service import Service

LEASE = 1.0
RAMP = 0.06
"""Seconds that the ramp takes: 600 rpm at 10,000 rpm/s."""
MARGIN = 0.3
_PLANT = """
name = "cell"
[buses.main]
port = "/dev/null"
baudrate = 115200
[axes.x]
bus = "main"
family = "mks"
address = 1
rpm = 600
acceleration = 10000
"""

CLIENT = """
import asyncio, sys
from rs485bus import remote
async def main():
    url, lease, how = sys.argv[1], float(sys.argv[2]), sys.argv[3]
    async with remote.connect(url, plant="cell", lease=lease) as plant:
        await plant.x.enable()
        if how == "move":
            plant.x.move_to(1000.0)
        elif how == "run":
            plant.x.run(600)
        else:
            async with plant.x.stream() as setpoint:
                for beat in range(100_000):
                    setpoint(600)
                    if beat == 15:
                        print("moving", flush=True)
                    await asyncio.sleep(0.02)
        await asyncio.sleep(0.3)
        print("moving", flush=True)
        await asyncio.sleep(3600)
asyncio.run(main())
"""
"""What a client does: the broker's address, the lease, and how it moves are its arguments."""

KINDS = ("client killed", "client's network cut", "broker killed", "service's network cut")
WAYS = ("move", "run", "stream")


@dataclass(frozen=True, slots=True)
class Cut:
    """What was measured."""

    kind: str
    how: str
    seconds: float
    """From the event until the shaft stood, by the drive's own motion."""
    confirmed: bool
    """The service saw it stand, too."""

    @property
    def holds(self) -> bool:
        return self.confirmed and self.seconds <= LEASE + RAMP + MARGIN

    def __str__(self) -> str:
        return f"{self.kind:22} {self.how:7} {1000 * self.seconds:7.0f} ms {'' if self.holds else 'TOO LONG'}"


class Namespace:
    """A network of its own, joined to this one by a cable that can be cut. It needs root."""

    def __init__(self) -> None:
        number = os.getpid() % 250
        self.name, self._cable = f"rs485-{os.getpid()}", f"rs{os.getpid()}"
        self.here, self.there = f"10.213.{number}.1", f"10.213.{number}.2"

    def __enter__(self) -> Namespace:
        self._ip("netns", "add", self.name)
        self._ip("link", "add", f"{self._cable}a", "type", "veth", "peer", "name", f"{self._cable}b")
        self._ip("link", "set", f"{self._cable}b", "netns", self.name)
        self._ip("addr", "add", f"{self.here}/24", "dev", f"{self._cable}a")
        self._ip("link", "set", f"{self._cable}a", "up")
        self._ip("-n", self.name, "addr", "add", f"{self.there}/24", "dev", f"{self._cable}b")
        self._ip("-n", self.name, "link", "set", f"{self._cable}b", "up")
        self._ip("-n", self.name, "link", "set", "lo", "up")
        return self

    def __exit__(self, *error: object) -> None:
        self._ip("link", "del", f"{self._cable}a")
        self._ip("netns", "del", self.name)

    def cut(self) -> None:
        """Nothing goes through any more, and nobody is told."""
        self._ip("-n", self.name, "link", "set", f"{self._cable}b", "down")

    @property
    def inside(self) -> tuple[str, ...]:
        """What stands before a command that runs inside."""
        return ("ip", "netns", "exec", self.name)

    @staticmethod
    def _ip(*arguments: str) -> None:
        subprocess.run(("ip", *arguments), check=True, capture_output=True)


def may_cut() -> bool:
    """Whether this user may make networks."""
    try:
        with Namespace():
            return True
    except (OSError, subprocess.CalledProcessError):
        return False


async def measure(folder: Path, kind: str, how: str) -> Cut:
    """One event, once."""
    with contextlib.ExitStack() as stack:
        network = stack.enter_context(Namespace()) if "network" in kind else None
        broker, inside = _broker(folder, kind, network)
        broker.start()
        stack.callback(broker.stop)
        async with served(folder, broker.url) as plant:
            client = await asyncio.create_subprocess_exec(
                *(*inside, sys.executable, "-c", CLIENT, broker.url, str(LEASE), how), stdout=asyncio.subprocess.PIPE
            )
            try:
                assert client.stdout is not None
                async with asyncio.timeout(30):
                    assert await client.stdout.readline() == b"moving\n"
                drive = plant.lines["main"].pair.devices[0]  # type: ignore[attr-defined] # the virtual line's
                assert drive.motion.motor.moving(_now())
                _events(client, network, broker)[kind]()
                return await _time_stop(plant, drive, kind, how)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    client.kill()
                await client.wait()


def _broker(folder: Path, kind: str, network: Namespace | None) -> tuple[Mosquitto, tuple[str, ...]]:
    """The broker, and what stands before the client's command."""
    if network is None:
        return Mosquitto(folder), ()
    if kind.startswith("client"):
        return Mosquitto(folder, host=network.here), network.inside
    return Mosquitto(folder, host=network.there, inside=network.inside), network.inside


def _events(
    client: asyncio.subprocess.Process, network: Namespace | None, broker: Mosquitto
) -> dict[str, Callable[[], None]]:
    cut = (lambda: None) if network is None else network.cut
    return {
        "client killed": client.kill,
        "client's network cut": cut,
        "broker killed": broker.kill,
        "service's network cut": cut,
    }


async def _time_stop(plant: Plant, drive: Any, kind: str, how: str) -> Cut:
    began = _now()
    while drive.motion.motor.moving(_now()) and _now() < began + 10:  # noqa: ASYNC110 - a shaft has no event
        await asyncio.sleep(0.002)
    seconds = _now() - began
    await asyncio.sleep(0.3)
    confirmed = plant.x.sample.moving is False and not drive.motion.motor.moving(_now())
    return Cut(kind, how, seconds, confirmed)


@contextlib.asynccontextmanager
async def served(folder: Path, url: str) -> AsyncIterator[Plant]:
    file = folder / "plant.toml"
    file.write_text(_PLANT)
    ledger = Ledger(":memory:")
    async with Plant.load(file, sim=True) as plant:
        service = Service(plant, Broker.at(url), ledger)
        running = asyncio.create_task(service.run())
        try:
            await service.online.wait()
            yield plant
        finally:
            running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await running
            ledger.close()


async def measure_all(folder: Path, repeats: int, ways: tuple[str, ...] = WAYS) -> AsyncIterator[Cut]:
    """Every event in the middle of every motion. Without root, no network is cut."""
    kinds = KINDS if may_cut() else tuple(kind for kind in KINDS if "network" not in kind)
    for how in ways:
        for kind in kinds:
            for _ in range(repeats):
                yield await measure(folder, kind, how)


def _now() -> float:
    return asyncio.get_running_loop().time()
