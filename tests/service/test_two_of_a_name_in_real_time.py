"""Two services of one plant, two clients of one name, a broker that is away or remembers what is over."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import time
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from benchmarks.service.mosquitto import Mosquitto
from rs485bus.errors import BrokerError, MoveCancelled, NotInControl, NotSent
from rs485bus.plant import Plant
from rs485bus.service.schema import Description, write
from rs485bus.service.topics import Topics
from tests.real.support import in_real_time
from tests.service.serving import CELL, connect, serving, unlike_any_other


def shaft(plant: Plant) -> float:
    """Where the shaft of x is, in turns."""
    drive = plant.lines["main"].pair.devices[0]
    return float(drive.motion.counts(asyncio.get_running_loop().time())) / 16384  # type: ignore[attr-defined]


async def wait_for(holds: Any, within: float = 10.0) -> None:
    async with asyncio.timeout(within):
        while not holds():  # noqa: ASYNC110 - what is waited for has no event
            await asyncio.sleep(0.02)


def test_of_services_that_begin_at_once_one_serves_and_a_verb_is_done_once(
    tmp_path: Path, broker: Mosquitto, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rs485bus.service.claim._FORMER", 0.0)  # nobody is there when they look
    name = unlike_any_other()

    async def main() -> None:
        shafts: list[float] = []
        refused: list[str] = []
        over = asyncio.Event()

        async def serve(number: int) -> None:
            folder = tmp_path / str(number)
            folder.mkdir()
            try:
                async with serving(folder, broker.url, name=name) as (plant, _):
                    await over.wait()
                    shafts.append(shaft(plant))
            except BrokerError as error:
                refused.append(str(error))

        async with asyncio.TaskGroup() as group:
            for number in range(3):
                group.create_task(serve(number))
            await wait_for(lambda: len(refused) == 2)
            async with connect(broker.url, plant=name) as cell:
                await cell.x.enable()
                await cell.x.move_by(1.0)
            over.set()
        assert shafts == [pytest.approx(1.0, abs=0.01)]
        assert all("is served at" in error and "already" in error for error in refused)

    in_real_time(main, 30)


@pytest.mark.parametrize("said", [b"", b"nonsense", b"offline"])
def test_what_somebody_else_says_of_the_plant_is_replaced(tmp_path: Path, broker: Mosquitto, said: bytes) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url) as (plant, service),
            aiomqtt.Client("127.0.0.1", broker.port) as somebody,
        ):
            gone = write(Description(status="offline", session="1", plant=plant.name))
            await somebody.publish(service.topics.service, gone if said == b"offline" else said, qos=1, retain=True)
            await asyncio.sleep(0.7)
            async with connect(broker.url, plant=plant.name) as cell:
                assert await cell.x.position() == 0

    in_real_time(main, 20)


def test_a_service_that_is_gone_without_a_word_is_asked_and_then_followed(
    tmp_path: Path, broker: Mosquitto, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A broker that was killed together with its service, and remembers: nothing goes offline."""
    monkeypatch.setattr("rs485bus.service.claim._DEAD", 1.0)
    name = unlike_any_other()

    async def main() -> None:
        async with aiomqtt.Client("127.0.0.1", broker.port) as former:
            gone = Description(status="online", session="former", plant=name, host="elsewhere")
            await former.publish(Topics(name).service, write(gone), qos=1, retain=True)
        async with serving(tmp_path, broker.url, name=name), connect(broker.url, plant=name) as cell:
            assert await cell.x.position() == 0

    in_real_time(main, 20)


def test_two_clients_of_one_name_do_not_cut_each_other_off_for_ever(
    tmp_path: Path, broker: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _):
            first = await connect(broker.url, plant=plant.name, client="panel")
            await first.x.enable()
            move = first.x.move_to(500.0)
            await wait_for(lambda: shaft(plant) > 0.1)
            async with connect(broker.url, plant=plant.name, client="panel") as second:
                with pytest.raises(MoveCancelled):
                    async with asyncio.timeout(5):
                        await move
                await asyncio.sleep(0.2)  # it is told of the cancellation while the stop is being confirmed
                stood = shaft(plant)
                clients = (first, second)
                await wait_for(lambda: "is another client called panel, too?" in caplog.text)
                await asyncio.sleep(0.5)
                told = await asyncio.gather(*(each.x.position().wait() for each in clients), return_exceptions=True)
                assert sorted(isinstance(each, BrokerError) for each in told) == [False, True]
                assert shaft(plant) == stood
            with contextlib.suppress(BrokerError):
                await first.close()

    in_real_time(main, 40)


def test_who_asks_while_the_broker_is_away_is_told_in_time_and_nothing_is_done_later(tmp_path: Path) -> None:
    async def main() -> None:
        broker = Mosquitto(tmp_path)
        broker.start()
        try:
            async with serving(tmp_path, broker.url) as (plant, service):
                cell = await connect(broker.url, plant=plant.name, patience=1.0)
                await cell.x.enable()
                broker.kill()
                await wait_for(lambda: not cell.session.connected.is_set())
                began = time.monotonic()
                for handle in (cell.x.position(), cell.x.stop(), cell.y.move_to(1.0)):
                    with pytest.raises(NotSent, match="no connection"):
                        await handle
                assert time.monotonic() - began < 3
                broker.start()
                await service.online.wait()
                await wait_for(cell.session.connected.is_set)
                await asyncio.sleep(0.3)
                assert await cell.x.position() == pytest.approx(0.0)
                assert await cell.y.position() == pytest.approx(0.0)
                await cell.close()
        finally:
            broker.stop()

    in_real_time(main, 30)


def test_who_looks_goes_on_looking_when_the_service_was_started_again(tmp_path: Path, broker: Mosquitto) -> None:
    name = unlike_any_other()

    async def main() -> None:
        async with contextlib.AsyncExitStack() as stack:
            async with serving(tmp_path, broker.url, name=name):
                cell = await stack.enter_async_context(connect(broker.url, plant=name))
                assert await cell.x.position() == 0
            await wait_for(lambda: cell.description.status == "offline")
            question = cell.x.position()
            async with serving(tmp_path, broker.url, name=name):
                assert await question == 0

    in_real_time(main, 30)


def test_who_was_made_for_another_plant_may_look_and_stop_and_moves_nothing(tmp_path: Path, broker: Mosquitto) -> None:
    """Three millimetres would be three turns."""
    name = unlike_any_other()
    in_mm = CELL.replace("address = 1", 'address = 1\nunits_per_turn = 8\nunit = "mm"')

    async def main() -> None:
        async with contextlib.AsyncExitStack() as stack:
            async with serving(tmp_path, broker.url, in_mm, name=name):
                cell = await stack.enter_async_context(connect(broker.url, plant=name))
                await cell.x.enable()
            await wait_for(lambda: cell.description.status == "offline")
            async with serving(tmp_path, broker.url, name=name) as (plant, _):
                await wait_for(lambda: cell.description.status == "online")
                for act in (cell.x.enable(), cell.take_control(), cell.x.move_to(3.0)):
                    with pytest.raises(NotInControl, match="started again as another plant"):
                        await act
                assert await cell.x.position() == 0
                await cell.x.stop()
                assert shaft(plant) == 0

    in_real_time(main, 30)


def test_nothing_that_a_client_is_told_ends_its_connection(
    tmp_path: Path, broker: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url) as (plant, service),
            connect(broker.url, plant=plant.name, client="panel") as cell,
            aiomqtt.Client("127.0.0.1", broker.port) as somebody,
        ):
            topics = service.topics
            answer = {"v": 1, "id": "1", "outcome": "failed", "now": 1.0}
            for topic in (topics.reply("panel"), topics.axis("x", "event"), topics.axis("x", "state")):
                for said in (b"", b"[" * 100_000, b'{"v": 9}', json.dumps(answer).encode()):
                    await somebody.publish(topic, said, qos=1)

            def fail(name: str, report: object) -> None:
                raise ZeroDivisionError("a mistake in a program that looks on")

            cell.session.on_report.append(fail)
            await wait_for(lambda: "could not be dealt with" in caplog.text)
            cell.session.on_report.remove(fail)
            await cell.x.enable()
            assert await cell.x.move_to(0.2) == pytest.approx(0.2, abs=0.01)

    with caplog.at_level(logging.ERROR):
        in_real_time(main, 20)


def test_a_service_that_is_ended_in_the_middle_of_a_move_stops_it_and_says_why(
    tmp_path: Path, broker: Mosquitto
) -> None:
    async def main() -> None:
        async with contextlib.AsyncExitStack() as stack:
            async with serving(tmp_path, broker.url) as (plant, _):
                cell = await stack.enter_async_context(connect(broker.url, plant=plant.name))
                await cell.x.enable()
                move = cell.x.move_to(500.0)
                await wait_for(lambda: shaft(plant) > 0.1)
            stood = shaft(plant)
            with pytest.raises(MoveCancelled, match="the service was ended"):
                await move
            await asyncio.sleep(0.2)
            assert shaft(plant) == stood
            await wait_for(lambda: not cell.session.served)

    in_real_time(main, 20)
