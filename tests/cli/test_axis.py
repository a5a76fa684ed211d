"""`rs485bus axis` and `estop`: on the virtual clock where a plant runs, as a process for what goes wrong."""

import asyncio
import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from rs485bus.cli.axis import VERBS, Order, run_order, stop_all
from rs485bus.cli.process import WrongUse
from rs485bus.cli.session import Where
from rs485bus.devices.mks import WorkMode
from rs485bus.errors import LimitExceeded, NotEnabled
from rs485bus.sim import SimMks, SimTlr, VirtualLine
from tests.cli.support import invoke, serving
from tests.cli.test_cli import COMMAND
from tests.integration.support import virtual
from tests.plant.support import CELL
from tests.real.support import in_real_time, posix, running

SIM = Where(sim=True)


@pytest.fixture
def cell(tmp_path: Path) -> Where:
    path = tmp_path / "plant.toml"
    path.write_text(CELL)
    return Where(plant=path, sim=True)


async def told(capsys: pytest.CaptureFixture[str], where: Where, name: str, verb: str, **order: Any) -> dict[str, Any]:
    code = await run_order(where, name, Order(verb=verb, **order), True)
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert result["done"] is (code == 0)
    return result


@pytest.mark.parametrize(
    ("name", "verb", "order", "position"),
    [
        ("mks1", "move-to", {"value": 2.0}, 2.0),
        ("mks1", "move-by", {"value": -1.5, "rpm": 100.0}, -1.5),
        ("mks1", "home", {}, 0.0),
        ("mks1", "zero", {}, 0.0),
        ("tlr3", "move-to", {"value": 1.0, "rpm": 200.0, "acceleration": 400.0}, 1.0),
        ("tlr3", "home", {"timeout": 30.0}, 0.0),
        ("zlac4.left", "move-to", {"value": 0.5}, 0.5),
        ("zlac4.right", "move-by", {"value": -0.5}, -0.5),
        ("mks2", "enable", {}, 0.0),
        ("tlr3", "disable", {}, 0.0),
        ("zlac4.left", "stop", {}, 0.0),
        ("mks2", "emergency-stop", {}, 0.0),
        ("zlac4.right", "clear-fault", {}, 0.0),
        ("mks1", "clear-fault", {}, 0.0),
        ("tlr3", "clear-fault", {}, 0.0),
    ],
)
@virtual
async def test_each_verb_is_carried_out_and_told(
    name: str, verb: str, order: dict[str, float], position: float, capsys: pytest.CaptureFixture[str]
) -> None:
    result = await told(capsys, SIM, name, verb, **order)
    assert result["axis"] == name
    assert result["position"] == pytest.approx(position, abs=0.01)


@virtual
async def test_a_run_for_a_time_ends_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    result = await told(capsys, SIM, "mks1", "run", value=60.0, duration=1.0)
    assert result["position"] == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("name", ["x", "y", "left", "right"])
@virtual
async def test_the_status_of_each_family_is_told(name: str, cell: Where, capsys: pytest.CaptureFixture[str]) -> None:
    result = await told(capsys, cell, name, "status")
    assert result["standing"] is True
    assert result["unit"] == ("mm" if name == "x" else "turns")
    assert result["drive"]
    assert await run_order(cell, name, Order(verb="status"), False) == 0
    assert "stands" in capsys.readouterr().out


@virtual
async def test_a_failure_is_told_to_programs_too(cell: Where, capsys: pytest.CaptureFixture[str]) -> None:
    result = await told(capsys, cell, "x", "move-to", value=500.0)
    assert result["error"] == "LimitExceeded"
    assert result["exit_code"] == 2
    with pytest.raises(LimitExceeded):
        await run_order(cell, "x", Order(verb="move-to", value=500.0), False)


@virtual
async def test_an_emergency_stop_tells_of_each_drive_whether_it_stands(
    cell: Where, capsys: pytest.CaptureFixture[str]
) -> None:
    assert await stop_all(cell, True) == 0
    assert [(one["family"], one["axes"], one["standing"]) for one in json.loads(capsys.readouterr().out)] == [
        ("MKS", ["x"], True),
        ("TL-R", ["y"], True),
        ("ZLAC", ["left", "right"], True),
    ]


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (Order(verb="hom"), "There is no verb 'hom'"),
        (Order(verb="move-to"), "needs a number"),
        (Order(verb="home", value=3.0), "takes no number"),
        (Order(verb="stop", rpm=3.0), "takes no --rpm"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_anything_is_opened(order: Order, words: str) -> None:
    with pytest.raises(WrongUse, match=words):
        order.check()


def test_every_verb_is_named_in_the_help() -> None:
    said = invoke("axis", "--help").said
    assert all(verb in said for verb in VERBS)


@posix
@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("tlr1", "status", "--tlr", "1"), 1, "a MKS SERVO (family mks), not a TL-R"),
        (("mks2", "home", "--mks", "2"), 1, "a TL-R (family tlr), not a MKS SERVO"),
        (("mks1", "status", "--mks", "1", "--baudrate", "9600"), 1, "Nobody has answered"),
        (("mks9", "enable", "--mks", "9"), 1, "Nobody has answered"),
        (("mks1", "home", "--mks", "1", "--tlr", "1"), 2, "given twice"),
        (("mks3", "home", "--mks", "1"), 2, "no axis 'mks3'"),
        (("mks1", "home"), 2, "Say which drives"),
    ],
)
def test_the_errors_of_a_beginner_say_what_to_do_in_real_time(
    arguments: tuple[str, ...], code: int, words: str
) -> None:
    with serving(SimMks(1), SimTlr(2)) as port:
        rate = () if "--baudrate" in arguments else ("--baudrate", "115200")
        result = invoke("axis", *arguments, "--port", port, *rate)
    assert words in result.said
    assert "Traceback" not in result.said
    assert result.returncode == code


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("axis", "x", "home"), 2, "Say which drives: --plant"),
        (("axis", "x", "home", "--plant", "nope.toml"), 2, "There is no plant file nope.toml"),
        (("axis", "mks1", "home", "--port", "/dev/ttyNOPE", "-b", "9600", "--mks", "1"), 4, "There is no port"),
        (("axis", "mks1", "home", "--port", "/dev/ttyNOPE", "--mks", "1"), 2, "Say the baud rate"),
        (("estop",), 2, "Say which drives"),
        (("jog", "mks1", "--sim"), 2, "run it in one"),
        (("axis", "mks1", "move-to", "--sim"), 2, "needs a number"),
    ],
)
def test_what_is_wrong_is_told_with_what_to_do(
    arguments: tuple[str, ...], code: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(*arguments)
    assert words in result.said
    assert "Traceback" not in result.said
    assert result.returncode == code


@posix
def test_ctrl_c_ends_a_run_with_the_motor_standing() -> None:
    async def main() -> None:
        sim = SimMks(1)
        line = VirtualLine(sim, baudrate=115200)
        loop = asyncio.get_running_loop()
        async with await line.serve_pty() as port:
            there = ("--port", port.path, "--baudrate", "115200", "--mks", "1")
            async with running(*COMMAND, "axis", "mks1", "run", "-120", *there, ready="turns at -120 rpm") as process:
                assert sim.moving(loop.time())
                assert sim.watchdog_ms == 1000
                process.send_signal(signal.SIGINT)
                assert await asyncio.wait_for(process.wait(), 20) == 130
            assert not sim.moving(loop.time())
            assert sim.watchdog_ms == 0

    in_real_time(main)


@posix
def test_jogging_by_keys_in_a_terminal_turns_the_motor_and_stops_it() -> None:
    async def main() -> None:
        import pty

        master, slave = pty.openpty()
        process = await asyncio.create_subprocess_exec(
            *COMMAND, "jog", "mks1", "--sim", "--rpm", "60", stdin=slave, stdout=slave, stderr=slave
        )
        os.close(slave)
        os.set_blocking(master, False)
        said = ""

        async def until(words: str) -> None:
            nonlocal said
            for _ in range(600):
                try:
                    said += os.read(master, 65536).decode(errors="replace")
                except BlockingIOError:
                    await asyncio.sleep(0.05)
                if words in said:
                    return
            raise AssertionError(said)

        try:
            await until("stands")
            said = ""
            for _ in range(6):
                os.write(master, b"\x1b[C")
                await asyncio.sleep(0.1)
            await until("60.0 rpm")
            said = ""
            await until("stands")
            os.write(master, b"q")
            assert await asyncio.wait_for(process.wait(), 20) == 0
            await until("mks1 stands:")
        finally:
            if process.returncode is None:
                process.kill()
            os.close(master)

    in_real_time(main)


@pytest.mark.parametrize("verb", ["enable", "home", "move-to"])
@virtual
async def test_a_wrong_work_mode_is_named_with_the_command_that_sets_it(
    verb: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = VirtualLine(SimMks(1, mode=WorkMode.CR_VFOC))
    monkeypatch.setattr("rs485bus.plant.plant.virtual_lines", lambda file: {"main": line})
    where = Where(sim=True, drives={"mks": [1]})
    with pytest.raises(NotEnabled, match="SR modes only") as caught:
        await run_order(where, "mks1", Order(verb=verb, value=1.0 if verb == "move-to" else None), False)
    assert caught.value.__notes__ == ["From here the work mode is set by: rs485bus settings write mks1 mode SR_VFOC"]


def test_vv_shows_each_frame_and_the_usual_is_quiet() -> None:
    assert invoke("axis", "tlr3", "status", "--sim").stderr == ""
    for words in (("axis", "tlr3", "status", "--sim", "-vv"), ("-vv", "axis", "tlr3", "status", "--sim")):
        loud = invoke(*words).stderr
        # How often it is looked at until it was seen to stand depends on this machine.
        assert "03 03 00 23 00 01" in loud
        assert loud.count("unit 3") > 5


def test_only_with_debug_is_there_a_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*arguments: object) -> None:
        raise RuntimeError("out of cheese")

    monkeypatch.setattr("rs485bus.cli.axis.status_of", broken)
    result = invoke("axis", "mks1", "status", "--sim")
    assert result.returncode == 1
    assert "RuntimeError: out of cheese This is a mistake in rs485bus. The same command with --debug" in result.said
    with pytest.raises(RuntimeError):
        invoke("axis", "mks1", "status", "--sim", "--debug")
