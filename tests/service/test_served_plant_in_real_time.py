"""A plant that is served at a real mosquitto, used by clients."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import aiomqtt
import anyio
import pytest

from benchmarks.service.mosquitto import Mosquitto, running
from rs485bus import remote
from rs485bus.bus.record import Record
from rs485bus.cli.axis import Order
from rs485bus.cli.over_broker import Served, run_order, stop_all
from rs485bus.cli.process import WrongUse
from rs485bus.errors import (
    BrokerError,
    EmergencyStopped,
    LimitExceeded,
    MoveCancelled,
    NoReply,
    NotInControl,
    RequestMalformed,
)
from rs485bus.plant import Plant
from rs485bus.service.broker import Broker
from rs485bus.service.topics import Topics
from tests.real.support import in_real_time
from tests.service.guide_page import ACCESS_LIST
from tests.service.serving import connect, serving

FAMILIES = """
name = "{name}"

[buses.main]
port = "{port}"
baudrate = 115200

[axes.x]
bus = "main"
family = "mks"
address = 1
acceleration = 10000

[axes.y]
bus = "main"
family = "tlr"
address = 2

[axes.left]
bus = "main"
family = "zlac"
address = 3
side = "left"

[axes.right]
bus = "main"
family = "zlac"
address = 3
side = "right"

[vehicle]
left = "left"
right = "right"
wheel_radius = 0.08
track = 0.4

[groups.xy]
axes = ["x", "y"]
"""


async def until(holds: Callable[[], bool], within: float = 10.0) -> None:
    """Wait until something holds."""
    async with asyncio.timeout(within):
        while not holds():  # noqa: ASYNC110 - what is waited for has no event
            await anyio.sleep(0.02)


async def stands(plant: Plant, within: float) -> None:
    """Wait until the axis x stands."""
    async with asyncio.timeout(within):
        while not await plant.x.idle():  # noqa: ASYNC110 - a drive has no event
            await anyio.sleep(0.02)


def test_the_verbs_of_all_families_are_done_from_afar(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url, FAMILIES) as (plant, _),
            connect(broker.url, plant=plant.name) as cell,
        ):
            assert list(cell.axes) == ["x", "y", "left", "right"]
            enabled = [cell.axes[name].enable() for name in cell.axes]
            for handle in enabled:
                await handle
            assert await cell.x.move_to(0.5) == pytest.approx(0.5, abs=0.01)
            assert await cell.xy.move_to(x=0.0, y=0.25) == pytest.approx({"x": 0.0, "y": 0.25}, abs=0.01)
            together = cell.move_by(x=0.25, left=0.2, duration=1.0)
            assert (await together)["left"] == pytest.approx(0.2, abs=0.02)
            assert together.spread is not None
            assert cell.vehicle is not None
            await cell.vehicle.drive(0.1, 0.0)
            await cell.vehicle.stop()
            assert await cell.left.idle()
            assert (await cell.x.status())["enabled"] is True
            with pytest.raises(LimitExceeded, match="outside"):
                await cell.x.move_to(1e9)
            with pytest.raises(RequestMalformed, match="no verb 'home'"):
                await cell.left.home()
            with pytest.raises(AttributeError, match="no axis and no group 'z'"):
                cell.z  # noqa: B018

    in_real_time(main, 40)


def test_states_samples_and_events_are_told(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url) as (plant, _),
            connect(broker.url, plant=plant.name) as cell,
            connect(broker.url, plant=plant.name) as other,
        ):
            told: list[str] = []
            other.session.on_event.append(lambda event: told.append(event.event))
            await cell.x.enable()
            await cell.x.run(60)
            positions = []
            async for sample in other.x.samples(0.02):
                positions.append(sample.position)
                if len(positions) == 10:
                    assert sample.holder == cell.session.client
                    assert sample.verb is None
                    break
            assert positions == sorted(positions)
            await other.x.stop()
            position = await plant.x.position()
            await until(lambda: other.x.report.position == pytest.approx(position, abs=0.001))
            assert other.x.report.stop is not None
            assert {"control taken", "stopped"} <= set(told)
            await until(lambda: "main" in other.buses)
            assert 0 < other.buses["main"].load < 1

    in_real_time(main, 20)


def test_who_is_killed_leaves_axes_that_stand(tmp_path: Path, broker: Mosquitto) -> None:
    script = (
        "import asyncio, sys; from rs485bus import remote\n"
        "async def main():\n"
        "    async with remote.connect(sys.argv[1], plant=sys.argv[2], lease=5) as plant:\n"
        "        await plant.x.enable(); await plant.x.run(60); print('runs', flush=True); await asyncio.sleep(60)\n"
        "asyncio.run(main())"
    )

    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _):
            client = await asyncio.create_subprocess_exec(
                sys.executable, "-c", script, broker.url, plant.name, stdout=asyncio.subprocess.PIPE
            )
            assert client.stdout is not None
            assert await client.stdout.readline() == b"runs\n"
            assert not await plant.x.idle()
            client.kill()
            await client.wait()
            await stands(plant, within=1.3)

    in_real_time(main, 20)


def test_a_broker_that_is_killed_ends_control_and_comes_back(tmp_path: Path) -> None:
    async def main() -> None:
        with running(tmp_path) as broker:
            async with (
                serving(tmp_path, broker.url) as (plant, service),
                connect(broker.url, plant=plant.name) as cell,
            ):
                await cell.x.enable()
                run = cell.x.run(60, duration=20.0)
                await run.begun.wait()
                await asyncio.sleep(0.2)
                broker.kill()
                await stands(plant, within=1.3)
                broker.start()
                with pytest.raises(MoveCancelled, match="lost the broker"):
                    await run
                await service.online.wait()
                await until(lambda: bool(cell.control_lost))
                with pytest.raises(NotInControl, match="Control was lost"):
                    await cell.x.move_to(0)
                await cell.take_control("x")
                await cell.x.move_to(0)

    in_real_time(main, 30)


def test_one_client_commands_an_axis_and_others_may_look_and_stop(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url) as (plant, _),
            connect(broker.url, plant=plant.name, client="one") as one,
            connect(broker.url, plant=plant.name, client="two") as two,
        ):
            await one.x.enable()
            run = one.x.run(60, duration=20.0)
            with pytest.raises(NotInControl, match="x is commanded by one"):
                await two.x.enable()
            await two.y.enable()
            await asyncio.sleep(0.2)
            assert await two.x.stop() == ["x"]
            with pytest.raises(MoveCancelled):
                await run
            async with one.x.move_to(0) as move:
                pass
            assert move.done()
            emergency = await two.emergency_stop()
            assert emergency == ["x", "y"]
            with pytest.raises(Exception, match="latched"):
                await one.x.move_to(1)
            await one.clear_emergency_stop()
            await one.x.enable()
            assert await one.x.move_to(0.1) == pytest.approx(0.1, abs=0.01)

    in_real_time(main, 20)


def test_axes_of_several_plants_start_at_a_common_time_and_the_skew_is_told_honestly(
    tmp_path: Path, broker: Mosquitto
) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url) as (first, _),
            serving(tmp_path, broker.url) as (second, _),
            connect(broker.url, plant=first.name) as one,
            connect(broker.url, plant=second.name) as other,
        ):
            for axis in (one.x, one.y, other.x):
                await axis.enable()
            started: list[float] = []
            for plant in (first, second):
                plant.buses["main"].subscribe(lambda record: _note_start(record, started))
            formation = remote.Formation(a=(one, one.x), b=(one, one.y), c=(other, other.x))
            move = formation.move_to(a=0.5, b=0.25, c=-0.5)
            assert await move == pytest.approx({"a": 0.5, "b": 0.25, "c": -0.5}, abs=0.01)
            assert move.skew is not None
            assert move.uncertainty is not None
            assert len(started) == 3
            true = max(started) - min(started)
            assert true < 0.2
            assert abs(move.skew - true) <= move.uncertainty + 0.005
            # Where one fails, the others are stopped before anybody is told.
            failing = formation.move_to(a=50.0, c=1e9, duration=600.0)
            with pytest.raises(LimitExceeded, match=rf"{second.name}: .*outside"):
                await failing
            assert await first.x.idle()

    in_real_time(main, 30)


def _note_start(record: Record, started: list[float]) -> None:
    """An MKS drive is told to go to a position (0xF5), and not to stop (speed 0)."""
    if record.request[1:4] == b"\x10\x00\xf5" and record.request[9:11] != b"\0\0":
        started.append(record.sent_at)


def test_set_points_hold_for_a_while_and_a_stop_ends_their_stream(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url) as (plant, _),
            connect(broker.url, plant=plant.name) as cell,
            connect(broker.url, plant=plant.name) as other,
        ):
            await cell.x.enable()
            async with cell.x.stream(timeout=1.0) as setpoint:
                for _ in range(10):
                    setpoint(60)
                    await asyncio.sleep(0.05)
                assert await plant.x.velocity() == pytest.approx(60, abs=5)
                await until(lambda: plant.x.sample.moving is False)  # nothing comes any more
                setpoint(-60)
                await until(lambda: plant.x.sample.rpm == pytest.approx(-60, abs=5))
                assert await other.x.stop() == ["x"]
                with pytest.raises(MoveCancelled, match="was stopped"):
                    for _ in range(100):
                        setpoint(-60)
                        await asyncio.sleep(0.05)
                assert await plant.x.idle()
            async with cell.x.stream(timeout=1.0) as setpoint:
                setpoint(30)
                await asyncio.sleep(0.2)
            assert await plant.x.idle()

    in_real_time(main, 40)


def test_set_points_of_a_vehicle_turn_both_wheels_and_a_stop_of_one_ends_their_stream(
    tmp_path: Path, broker: Mosquitto
) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, broker.url, FAMILIES) as (plant, _),
            connect(broker.url, plant=plant.name) as cell,
            connect(broker.url, plant=plant.name) as other,
        ):
            assert cell.vehicle is not None
            for wheel in (cell.left, cell.right):
                await wheel.enable()

            def wheels() -> tuple[float | None, float | None]:
                return plant.left.sample.rpm, plant.right.sample.rpm

            async with cell.vehicle.stream(timeout=1.0) as setpoint:
                with pytest.raises(TypeError, match="2 values"):
                    setpoint(0.1)
                for _ in range(10):
                    setpoint(0.4, 0.0)
                    await asyncio.sleep(0.05)
                rpm = 0.4 / 0.08 / (2 * math.pi) * 60
                await until(lambda: wheels() == (pytest.approx(rpm, abs=3), pytest.approx(rpm, abs=3)))
                await until(lambda: plant.left.sample.moving is plant.right.sample.moving is False)  # it grows stale
                setpoint(0.0, 1.0)
                turning = 1.0 * 0.2 / 0.08 / (2 * math.pi) * 60
                await until(lambda: wheels() == (pytest.approx(-turning, abs=3), pytest.approx(turning, abs=3)))
                await other.left.stop()
                with pytest.raises(MoveCancelled, match="was stopped"):
                    for _ in range(100):
                        setpoint(0.0, 1.0)
                        await asyncio.sleep(0.05)
            await until(lambda: plant.left.sample.moving is plant.right.sample.moving is False)

    in_real_time(main, 40)


def test_a_block_that_is_left_by_an_exception_stops(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _):
            with pytest.raises(ZeroDivisionError):
                async with connect(broker.url, plant=plant.name) as cell:
                    await cell.x.enable()
                    await cell.x.run(60)
                    raise ZeroDivisionError
            assert await plant.x.idle()
            async with connect(broker.url, plant=plant.name) as cell:
                await cell.y.enable()

    in_real_time(main, 20)


def test_a_service_and_a_client_end_in_time_though_the_broker_does_not_answer(tmp_path: Path) -> None:
    async def main() -> None:
        with running(tmp_path) as broker:
            async with contextlib.AsyncExitStack() as stack:
                plant, _ = await stack.enter_async_context(serving(tmp_path, broker.url))
                cell = await stack.enter_async_context(connect(broker.url, plant=plant.name, patience=1.0))
                await cell.x.enable()
                os.kill(broker.pid, signal.SIGSTOP)
                began = asyncio.get_running_loop().time()
                try:
                    with pytest.raises(NoReply):
                        await stack.aclose()
                    assert asyncio.get_running_loop().time() - began < 6
                finally:
                    os.kill(broker.pid, signal.SIGCONT)

    in_real_time(main, 20)


def test_the_commands_work_through_the_service(
    tmp_path: Path, broker: Mosquitto, capsys: pytest.CaptureFixture[str]
) -> None:
    def said() -> str:
        return " ".join(capsys.readouterr().out.split())

    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _):
            at = Served(broker.url, Path(plant.name), None, None, None)
            assert await run_order(at, "x", Order(verb="move-to", value=0.5), False) == 0
            assert said() == "x has arrived: 0.5."
            assert await run_order(at, "x", Order(verb="status"), True) == 0
            assert json.loads(said())["position"] == 0.5
            assert await stop_all(at, False) == 0
            assert said() == "x, y stand."
            with pytest.raises(EmergencyStopped, match="latched"):
                await run_order(at, "x", Order(verb="move-to", value=1.0), False)
            assert await run_order(at, "x", Order(verb="enable"), True) == 1
            assert json.loads(said())["error"] == "EmergencyStopped"
            with pytest.raises(WrongUse, match="has no axis 'q': x, y"):
                await run_order(at, "q", Order(verb="stop"), False)

    in_real_time(main, 60)


# What goes wrong


def test_a_plant_that_is_not_there_is_told_with_those_that_are(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _):
            with pytest.raises(BrokerError, match=rf"no plant 'cel' at .* Served there: .*{plant.name}"):
                async with connect(broker.url, plant="cel"):
                    pass
        with pytest.raises(BrokerError, match="offline now"):
            async with connect(broker.url, plant=plant.name):
                pass

    in_real_time(main, 20)


def test_a_plant_is_served_once(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url, name="twice") as (plant, _):
            (tmp_path / "other").mkdir()
            with pytest.raises(BrokerError, match=r"is served at .* already"):
                async with serving(tmp_path / "other", broker.url, name="twice"):
                    pass
            assert plant.name == "twice"

    in_real_time(main, 30)


def test_nobody_at_the_port_is_told_in_words(tmp_path: Path) -> None:
    async def main() -> None:
        with pytest.raises(BrokerError, match="Nobody listens at mqtt://127"):
            async with connect("mqtt://127.0.0.1:1", plant="cell"):
                pass

    in_real_time(main, 10)


def test_users_passwords_and_access_lists_keep_out_who_is_not_meant(tmp_path: Path) -> None:
    passwords, acl = tmp_path / "passwords", tmp_path / "acl"
    for option, user in (("-c", "service"), ("", "operator"), ("", "guest")):
        words = ("mosquitto_passwd", "-b", *([option] if option else []), str(passwords), user, "secret")
        subprocess.run(words, check=True, capture_output=True)
    acl.write_text(ACCESS_LIST)

    async def main(broker: Mosquitto) -> None:
        def at(user: str, password: str = "secret") -> str:
            return broker.url.replace("//", f"//{user}:{password}@")

        async with serving(tmp_path, at("service")) as (plant, _):
            for user, password in (("operator", "guess"), ("nobody", "secret")):
                with pytest.raises(BrokerError, match=r"refuses the connection: .*(authorized|password)"):
                    async with connect(at(user, password), plant=plant.name):
                        pass
            async with connect(at("operator"), plant=plant.name) as cell:
                await cell.x.enable()
                assert await cell.x.move_to(0.1) == pytest.approx(0.1, abs=0.01)
            async with connect(at("guest"), plant=plant.name) as cell:
                assert await cell.x.position() == pytest.approx(0.1, abs=0.01)
                with pytest.raises(BrokerError, match=r"does not take .*take_control from .*Not authorized"):
                    await cell.x.move_to(2)
                with pytest.raises(BrokerError, match=r"does not take .*/stop"):
                    await cell.stop()
                assert await cell.emergency_stop() == ["x", "y"]
            assert await plant.x.position() == pytest.approx(0.1, abs=0.01)
        with pytest.raises(BrokerError, match=r"does not take .*/service from"):
            async with serving(tmp_path, at("guest")):
                pass

    with running(tmp_path, f"password_file {passwords}\nacl_file {acl}", anonymous=False) as broker:
        in_real_time(lambda: main(broker), 30)


def make_certificates(folder: Path) -> None:
    """An authority, and what it signs for a broker at 127.0.0.1."""
    key = "-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes"
    for words in (
        f"req -x509 {key} -keyout ca.key -out ca.crt -days 2 -subj /CN=drives "
        "-addext keyUsage=critical,keyCertSign,cRLSign",
        f"req {key} -keyout server.key -out server.csr -subj /CN=127.0.0.1",
        "x509 -req -in server.csr -CA ca.crt -CAkey ca.key -CAcreateserial -out server.crt -days 2 -extfile names",
    ):
        (folder / "names").write_text("subjectAltName=IP:127.0.0.1")
        subprocess.run(("openssl", *words.split()), cwd=folder, check=True, capture_output=True)


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # paho leaves what it does not trust open
def test_the_connection_is_encrypted_where_that_is_asked_for_and_only_to_who_is_trusted(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    ca = str(tmp_path / "ca.crt")

    async def main(broker: Mosquitto) -> None:
        url = broker.url.replace("mqtt:", "mqtts:")
        async with (
            serving(tmp_path, Broker.at(url, ca=ca)) as (plant, _),
            connect(url, plant=plant.name, ca=ca) as cell,
        ):
            assert await cell.x.position() == 0
            with pytest.raises(BrokerError, match=r"is not trusted: .* Name who signed it"):
                async with connect(url, plant=plant.name):
                    pass
            with pytest.raises(BrokerError):
                async with connect(broker.url, plant=plant.name):
                    pass
        with pytest.raises(BrokerError, match=r"A certificate .* cannot be used"):
            async with connect(url, plant="cell", ca=str(tmp_path / "nothing.crt")):
                pass

    tls = "\n".join(
        f"{what} {tmp_path / file}" for what, file in (("certfile", "server.crt"), ("keyfile", "server.key"))
    )
    with running(tmp_path, tls) as broker:
        in_real_time(lambda: main(broker), 30)
    gc.collect()


def test_a_client_that_speaks_an_old_mqtt_or_another_schema_is_told_and_nothing_moves(
    tmp_path: Path, broker: Mosquitto
) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url) as (plant, _):
            topics = Topics(plant.name)
            async with aiomqtt.Client("127.0.0.1", broker.port, protocol=aiomqtt.ProtocolVersion.V311) as old:
                await old.subscribe(topics.refused)
                told = []
                for payload in ({"v": 1, "id": "1"}, {"v": 0, "id": "2"}, "move!"):
                    await old.publish(topics.request("x", "move_to"), json.dumps(payload), qos=1)
                    async for message in old.messages:
                        told.append(json.loads(message.payload)["error"]["message"])
                        break
            assert "needs a response topic (MQTT 5)" in told[0]
            assert await plant.x.position() == 0

    in_real_time(main, 20)


def test_a_service_of_another_version_is_told_of_when_a_client_connects(broker: Mosquitto) -> None:
    async def main() -> None:
        async with aiomqtt.Client("127.0.0.1", broker.port) as newer:
            later = {"v": 2, "status": "online", "session": "1", "plant": "later"}
            await newer.publish(Topics("later").service, json.dumps(later), qos=1, retain=True)
            with pytest.raises(RequestMalformed, match="version 2 of the schema, and this side speaks version 1"):
                async with connect(broker.url, plant="later"):
                    pass
            await newer.publish(Topics("later").service, b"", qos=1, retain=True)

    in_real_time(main, 10)


def test_home_assistant_finds_states_and_stops_and_nothing_that_moves(tmp_path: Path, broker: Mosquitto) -> None:
    async def main() -> None:
        async with serving(tmp_path, broker.url, home_assistant=True) as (plant, _):
            found: dict[str, dict[str, str]] = {}
            async with aiomqtt.Client("127.0.0.1", broker.port) as home:
                await home.subscribe("homeassistant/#")
                async for message in home.messages:
                    found[str(message.topic)] = json.loads(message.payload)
                    if len(found) == 12:
                        break
            commands = {entry["command_topic"] for entry in found.values() if "command_topic" in entry}
            topics = Topics(plant.name)
            assert commands == {topics.stop, topics.emergency_stop}
            assert f"homeassistant/sensor/{plant.name}_x_position/config" in found

    in_real_time(main, 10)
