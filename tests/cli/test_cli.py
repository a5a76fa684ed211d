"""The command `rs485bus`: what a person sees, in real time where a plant runs."""

import asyncio
import io
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from rs485bus import MksServo, TlrStepper, open_bus
from rs485bus.cli.demo import run_demo
from rs485bus.cli.process import console
from rs485bus.cli.serve import FAMILIES, serve
from rs485bus.cli.session import Where
from rs485bus.sim import Machine, SimMks, VirtualLine
from tests.cli.support import invoke, serving
from tests.integration.support import virtual
from tests.plant.support import CELL
from tests.real.support import in_real_time, posix, running

COMMAND = (sys.executable, "-m", "rs485bus")


def call(*arguments: str, within: float = 30.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run((*COMMAND, *arguments), capture_output=True, text=True, timeout=within, check=False)


def test_without_its_extra_it_says_what_to_install() -> None:
    script = "import sys; sys.modules['typer'] = None; from rs485bus.cli import main; main()"
    result = subprocess.run((sys.executable, "-c", script), capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert 'pip install "rs485bus[cli]"' in result.stderr
    assert "Traceback" not in result.stderr


def test_its_help_names_the_commands() -> None:
    result = call("--help")
    assert result.returncode == 0
    assert "demo" in result.stdout
    assert "sim" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("demo", "--port", "/dev/ttyNOPE"), "PortNotFound: There is no port /dev/ttyNOPE."),
        (("demo", "--mks", "300"), "247"),
        (("demo", "--mks", "1", "--mks", "1"), "An address is given twice"),
        (("demo", "--baudrate", "1"), "300"),
    ],
)
def test_wrong_input_is_told_in_words(arguments: tuple[str, ...], said: str) -> None:
    result = invoke(*arguments)
    assert result.returncode != 0
    assert said in result.said
    assert "Traceback" not in result.stderr


def test_the_demo_counts_down_on_an_open_port_only() -> None:
    result = invoke("demo", "--port", "/dev/ttyNOPE")
    assert "There is no port /dev/ttyNOPE." in " ".join(result.stderr.split())
    assert result.stdout == ""


def test_verify_watchdog_asks_before_it_moves_anything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("n\n"))
    result = invoke("verify-watchdog", "--mks", "1")
    assert result.returncode == 1
    assert "Is it alone and free to turn?" in result.stdout
    assert "Nothing was moved." in result.stdout


def test_verify_watchdog_says_what_feeds_a_drive() -> None:
    result = invoke("verify-watchdog", "--mks", "1", "--yes")
    assert result.returncode == 0, result.stderr
    assert "reads only: it goes on turning" in result.stdout
    assert "frames to others only: it stops" in result.stdout
    assert "the heartbeats keep it fed" in " ".join(result.stdout.split())


@posix
def test_sim_prints_its_port_serves_until_interrupted_and_says_what_it_saw(tmp_path: Path) -> None:
    async def main() -> None:
        link = tmp_path / "port"
        drives = ("--mks", "4", "--zlac", "5", "--tlr", "6")
        arguments = ("sim", *drives, "--baudrate", "115200", "--link", str(link))
        async with running(*COMMAND, *arguments) as process:
            assert process.stdout is not None
            path = (await asyncio.wait_for(process.stdout.readline(), 20)).decode().strip()
            assert str(link.readlink()) == path
            demo = await asyncio.to_thread(call, "demo", "--port", path, "--baudrate", "115200", "--mks", "4")
            assert demo.returncode == 0, demo.stdout + demo.stderr
            assert "will home and turn some turns. Ctrl-C stops them" in demo.stdout
            assert "every axis stands, every watchdog is off" in demo.stdout
            async with open_bus(path, baudrate=115200) as bus:
                assert await bus.unit(5).read_holding_registers(0x2001) == [5]
                assert await bus.unit(6).read_holding_registers(0x23) == [4000]
            process.send_signal(signal.SIGINT)
            output, _ = await asyncio.wait_for(process.communicate(), 10)
        assert b"MKS 4, ZLAC 5, TL-R 6 at 115200 bit/s" in output
        assert b"a switch 2 turns below the start of each MKS, 2 turns above the start of each TL-R." in output
        assert b"0 of them before t3.5" in output
        assert process.returncode == 130

    in_real_time(main)


@posix
def test_drives_of_sim_are_at_the_rate_that_is_said(tmp_path: Path) -> None:
    async def main() -> None:
        link = tmp_path / "port"
        drives = {"MKS": [4], "ZLAC": [5], "TL-R": [6]}
        serving = asyncio.create_task(serve(38400, drives, str(link), Console(file=io.StringIO())))
        while not link.is_symlink():  # noqa: ASYNC110 - serve() tells nobody
            await asyncio.sleep(0.01)
        async with open_bus(str(link), baudrate=38400) as bus:
            assert await bus.unit(4).read_input_registers(0xF1) == [1]
            assert await bus.unit(5).read_holding_registers(0x2001) == [5]
            assert await bus.unit(6).read_holding_registers(0x23) == [4000]
        serving.cancel()

    in_real_time(main)


@pytest.mark.parametrize(("family", "facade"), [("MKS", MksServo), ("TL-R", TlrStepper)])
@virtual
async def test_the_drives_of_sim_have_what_their_homing_as_shipped_needs(
    family: str, facade: type[MksServo] | type[TlrStepper]
) -> None:
    async with open_bus(VirtualLine(FAMILIES[family](4))) as bus:
        axis = facade(bus, 4)
        axis.enable()
        assert await axis.home() == 0.0


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_in_the_demo_stops_every_axis_and_says_so(number: signal.Signals) -> None:
    async def main() -> None:
        sims = [SimMks(address, machine=Machine(home_switch=-1.0)) for address in (1, 2)]
        line = VirtualLine(*sims, baudrate=115200)
        loop = asyncio.get_running_loop()
        arguments = ("demo", "--baudrate", "115200", "--mks", "1", "--mks", "2")
        async with await line.serve_pty() as port:
            async with running(*COMMAND, *arguments, "--port", port.path) as process:
                for _ in range(400):
                    if all(sim.moving(loop.time()) for sim in sims):
                        break
                    await asyncio.sleep(0.05)
                await asyncio.sleep(0.2)
                process.send_signal(number)
                output, _ = await asyncio.wait_for(process.communicate(), 10)
            assert b"Every axis was stopped and seen standing." in output
            assert process.returncode == 130
            assert not any(sim.moving(loop.time()) for sim in sims)
            assert [sim.watchdog_ms for sim in sims] == [0, 0]

    in_real_time(main)


@posix
def test_sim_replaces_no_file_by_its_link(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text("x = 1")
    result = invoke("sim", "--link", str(mine))
    assert result.returncode == 2
    assert "no symbolic link" in " ".join(result.stderr.split())
    assert mine.read_text() == "x = 1"


@posix
def test_the_demo_moves_no_drive_of_a_port_that_was_not_named() -> None:
    sim = SimMks(1)
    with serving(sim, baudrate=38400) as port:
        result = invoke("demo", "--port", port)
    assert result.returncode == 2
    assert "may be moved: --mks 1, --tlr 2, --zlac 3. No other is." in result.said
    assert sim.moves == 0


@virtual
async def test_the_demo_shows_all_families_of_a_plant_file_and_its_vehicle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "plant.toml"
    path.write_text(CELL)
    assert await run_demo(Where(plant=path, sim=True), console()) == 0
    said = capsys.readouterr().out
    for name in ("x", "y", "left", "right"):
        assert f"{name:11} to 0 " in said
    assert "vehicle  a curve: x 0." in said
    assert "every axis stands, every watchdog is off" in said
