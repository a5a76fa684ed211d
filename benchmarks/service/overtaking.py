"""How long an emergency stop by topic takes to the wire, while a thousand messages a second come in."""

from __future__ import annotations

import asyncio
import contextlib
import json
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import aiomqtt

from benchmarks.service.cuts import served
from benchmarks.service.mosquitto import running
from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Urgency
from rs485bus.remote import connect
from rs485bus.service.broker import Broker
from rs485bus.service.schema import Request, SetPoint, write
from rs485bus.service.topics import Topics

_TOPICS = Topics("cell")


@dataclass(frozen=True, slots=True)
class Overtaking:
    """What was measured, in seconds."""

    latencies: list[float]
    rate: float
    """Messages a second that came in meanwhile."""

    @property
    def holds(self) -> bool:
        return statistics.median(self.latencies) <= 0.020 and self.rate >= 950

    def __str__(self) -> str:
        ordered = sorted(1000 * latency for latency in self.latencies)
        return (
            f"emergency stop by topic, under {self.rate:.0f} messages a second: on the wire after "
            f"{statistics.median(ordered):.1f} ms (median of {len(ordered)}; 90 % "
            f"{ordered[int(0.9 * len(ordered))]:.1f}, longest {ordered[-1]:.1f})"
        )


async def measure(folder: Path, stops: int, rate: float) -> Overtaking:
    """Press the button so many times."""
    latencies: list[float] = []
    loop = asyncio.get_running_loop()
    with running(folder) as broker:
        async with served(folder, broker.url) as plant:
            sent: list[float] = []

            def look(record: Record) -> None:
                if record.urgency is Urgency.STOP:
                    sent.append(record.sent_at)

            plant.buses["main"].subscribe(look)
            # The flood comes from a process of its own, as other clients do.
            flood = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "benchmarks.service.overtaking", broker.url, str(rate)),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
            )
            assert flood.stdin is not None
            assert flood.stdout is not None
            await flood.stdout.readline()
            async with connect(broker.url, plant="cell", lease=10, life=10) as cell:
                for _ in range(stops):
                    await cell.x.enable()
                    await cell.x.run(600)
                    sent.clear()
                    pressed = loop.time()
                    await cell.emergency_stop()
                    latencies.append(sent[0] - pressed)
                    await cell.clear_emergency_stop()
            flood.stdin.close()
            told = json.loads(await flood.stdout.readline())
            await flood.wait()
    return Overtaking(latencies, told["rate"])


def _messages() -> Iterator[tuple[str, bytes, bool]]:
    """What others say: questions, verbs without control, set-points of no stream, presence of nobody."""
    number = 0
    while True:
        now = time.time()
        number += 1
        request = Request(id=f"flood-{number}", client="flood", sent=now - 0.1, expires=now + 2, args={"position": 1.0})
        yield _TOPICS.request("x", "move_to"), write(request), True
        yield _TOPICS.request("plant", "time"), write(request.model_copy(update={"args": {}})), True
        said = SetPoint(stream="none", client="flood", lease=1, sent=now, n=number, values=[1.0])
        yield _TOPICS.setpoint("x"), write(said), False


async def _flood(url: str, rate: float) -> None:
    """Send so many messages a second, until the standard input ends."""
    loop = asyncio.get_running_loop()
    over = loop.run_in_executor(None, sys.stdin.read)
    async with Broker.at(url).connect("flood") as client:
        from rs485bus.service.broker import asking
        from rs485bus.service.decisions import Asker

        properties = asking(Asker(_TOPICS.reply("flood"), b"1"), 2)
        print("{}", flush=True)
        began, count = loop.time(), 0
        for topic, payload, asks in _messages():
            if over.done():
                break
            with contextlib.suppress(aiomqtt.MqttError):
                client.send(topic, payload, qos=0, properties=properties if asks else None)
            count += 1
            ahead = began + count / rate - loop.time()
            if ahead > 0.002:
                await asyncio.sleep(ahead)
            elif count % 20 == 0:
                await asyncio.sleep(0)
        print(json.dumps({"rate": count / (loop.time() - began)}), flush=True)


if __name__ == "__main__":
    asyncio.run(_flood(sys.argv[1], float(sys.argv[2])))
