"""A client that is written from the guide's table of topics alone: what it says wrongly moves nothing.

The judges are the shafts of the virtual drives, and what the client was told.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from benchmarks.service.mosquitto import Mosquitto
from rs485bus.plant import Plant
from tests.real.support import in_real_time
from tests.service.serving import serving
from tests.service.test_two_of_a_name_in_real_time import shaft, wait_for

_PAUSE = 0.25
_RAMP = 0.5
"""Seconds in which the ramp of a stop ends."""


class Raw:
    """A connection, and what came in."""

    def __init__(self, mqtt: aiomqtt.Client, plant: str, name: str) -> None:
        self.root = f"rs485bus/{plant}"
        self.name = name
        self.lease: int | None = None
        self.told: list[dict[str, Any]] = []
        self._mqtt = mqtt
        self._count = 0

    async def listen(self) -> None:
        await self._mqtt.subscribe([(f"{self.root}/reply/{self.name}", 1), (f"{self.root}/refused", 1)])
        async for message in self._mqtt.messages:
            self.told.append(json.loads(bytes(message.payload)))  # type: ignore[arg-type]

    def request(self, **fields: Any) -> dict[str, Any]:
        self._count += 1
        now = time.time() - 0.02
        said = {"v": 1, "id": f"{self.name}-{self._count}", "client": self.name, "sent": now, "expires": now + 5}
        return {**said, "lease": self.lease, "args": {"distance": 1.0}, **fields}

    async def send(
        self, what: str, said: Any, *, reply: str | None = "own", correlation: bytes = b"c", retain: bool = False
    ) -> None:
        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        if reply is not None:
            properties.ResponseTopic = f"{self.root}/reply/{self.name}" if reply == "own" else reply
        if correlation:
            properties.CorrelationData = correlation
        payload = said if isinstance(said, bytes) else json.dumps(said)
        await self._mqtt.publish(f"{self.root}/{what}", payload, qos=1, properties=properties, retain=retain)

    async def ends(self, request: str, within: float = 5.0, times: int = 1) -> list[dict[str, Any]]:
        """How a request has ended, as often as that was told, once it was told so often."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within):
                while len(self._ends(request)) < times:  # noqa: ASYNC110 - messages have no event here
                    await asyncio.sleep(0.01)
        return self._ends(request)

    def _ends(self, request: str) -> list[dict[str, Any]]:
        return [told for told in self.told if told["id"] == request and told["outcome"] != "begun"]

    async def ask(self, what: str, **fields: Any) -> dict[str, Any]:
        said = self.request(**fields)
        await self.send(f"request/{what}", said)
        (end, *_) = await self.ends(said["id"])
        return end

    async def take(self, *axes: str) -> None:
        told = await self.ask("plant/take_control", args={"axes": axes, "seconds": 60.0})
        self.lease = told["value"]["lease"]


@contextlib.asynccontextmanager
async def connected(broker: Mosquitto, plant: Plant, name: str) -> AsyncIterator[Raw]:
    async with aiomqtt.Client(
        "127.0.0.1", broker.port, identifier=f"{plant.name}-{name}", protocol=aiomqtt.ProtocolVersion.V5
    ) as mqtt:
        raw = Raw(mqtt, plant.name, name)
        listening = asyncio.create_task(raw.listen())
        try:
            await asyncio.sleep(0.1)
            yield raw
        finally:
            listening.cancel()


def test_an_id_is_used_once_whoever_uses_it_and_for_whatever(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url) as (plant, _),
            connected(broker, plant, "a") as a,
            connected(broker, plant, "b") as b,
        ):
            await a.take("x")
            await b.take("y")
            await a.ask("x/enable", args={})
            said = a.request(id="1")
            await asyncio.gather(*(a.send("request/x/move_by", said, correlation=bytes([n])) for n in range(4)))
            assert [end["outcome"] for end in await a.ends("1", times=4)] == ["done"] * 4
            assert shaft(plant) == pytest.approx(1.0, abs=0.01)
            await a.send("request/x/move_to", a.request(id="1", args={"position": 9.0}))
            await b.send("request/y/move_by", b.request(id="1"))
            await a.send("request/y/move_by", a.request(id="2"))
            stolen = {**a.request(id="3"), "client": "b"}
            await b.send("request/x/move_by", stolen)
            assert "was used for another request" in (await b.ends("1"))[0]["error"]["message"]
            assert (await a.ends("2"))[0]["error"]["type"] == "NotInControl"
            assert (await b.ends("3"))[0]["error"]["type"] == "NotInControl"
            await asyncio.sleep(_PAUSE)
            assert shaft(plant) == pytest.approx(1.0, abs=0.01)

    in_real_time(main, 30)


def test_what_is_said_clumsily_is_answered_in_words_and_moves_nothing(
    tmp_path: Path, broker: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _), connected(broker, plant, "a") as a:
            await a.take("x")
            await a.ask("x/enable", args={})
            lease, now = a.lease, time.time()
            assert lease is not None
            for said, words in (
                ({"v": 0}, "version 0 of the schema, and this side speaks version 1"),
                ({"v": 2, "force": 1}, "version 2 of the schema"),
                ({"args": {"distance": "1"}}, "args.distance"),
                ({"args": {"distance": float("nan")}}, "args.distance"),
                ({"args": {"distanc": 1.0}}, "args.distanc"),
                ({"lease": -1}, "lease: "),
                ({"lease": lease + 1}, "names a lease that has ended"),
                ({"lease": None}, "names no lease"),
                ({"sent": now + 3600, "expires": now + 3602}, "from now, by the service's clock"),
                ({"sent": now - 3600, "expires": now - 3590}, "expired 35"),
                ({"expires": now + 3600}, "must expire within 60 s"),
            ):
                end = await a.ask("x/move_by", **said)
                assert end["outcome"] == "refused", said
                assert words in end["error"]["message"], said
            assert "There is no 'nowhere' here: x, y, xy" in (await a.ask("nowhere/move_by"))["error"]["message"]
            assert "x has no verb 'fly'" in (await a.ask("x/fly"))["error"]["message"]
            retained = a.request()
            await a.send("request/x/move_by", retained, retain=True)
            assert "retained" in (await a.ends(retained["id"]))[0]["error"]["message"]
            await a.send("request/x/move_by", b"", retain=True)
            for reply in (None, "rs485bus/other/reply/a"):
                lost = a.request()
                await a.send("request/x/move_by", lost, reply=reply)
                assert "response topic" in (await a.ends(lost["id"]))[0]["error"]["message"]
            await a.send("request/x/move_by", b"x" * 1_000_000)
            for length in (100_000, 3_000_000):
                await a.send("setpoint/x", b"[" * length)
            assert (await a.ask("x/position", args={}))["value"] == 0
            assert "100000 bytes" in caplog.text
            assert "3000000 bytes" not in caplog.text  # to take that in, the event loop would stand still
            assert shaft(plant) == 0
            # Correlation data is for the client's own use: it may do without.
            plain = a.request()
            await a.send("request/x/move_by", plain, correlation=b"")
            assert (await a.ends(plain["id"]))[0]["outcome"] == "done"
            assert shaft(plant) == pytest.approx(1.0, abs=0.01)

    in_real_time(main, 30)


@pytest.mark.parametrize(
    "payload", [b"", b"[" * 1_000_000, b'{"v": 9, "axes": ["y"]}'], ids=["none", "a megabyte", "v9"]
)
def test_a_stop_that_is_garbage_stops_while_requests_pour_in(tmp_path: Path, broker: Mosquitto, payload: bytes) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url) as (plant, _),
            connected(broker, plant, "a") as a,
            connected(broker, plant, "b") as b,
        ):
            await a.take("x")
            await a.ask("x/enable", args={})
            move = a.request(args={"distance": 500.0})
            await a.send("request/x/move_by", move)
            await wait_for(lambda: shaft(plant) > 0.1)
            for _ in range(20):
                for what in ("x/position", "y/status", "x/move_by"):
                    await b.send(f"request/{what}", b.request(args={}))
            await b.send("stop", payload)
            assert (await a.ends(move["id"]))[0]["error"]["type"] == "MoveCancelled"
            await asyncio.sleep(_RAMP)
            stood = shaft(plant)
            await asyncio.sleep(_PAUSE)
            assert shaft(plant) == stood < 100
            assert (await a.ask("x/position", args={}))["outcome"] == "done"

    in_real_time(main, 30)
