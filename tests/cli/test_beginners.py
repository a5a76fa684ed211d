"""What somebody does wrong who is new to it. Each is told what to do, before anything is sent."""

from __future__ import annotations

import asyncio
import errno
import io
import json
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest
import serial

from rs485bus.cli import main, process
from rs485bus.cli.axis import Order, run_order
from rs485bus.cli.session import Where
from rs485bus.sim import SimMks, SimTlr, VirtualLine
from rs485bus.transport.permission import how_to_be_allowed
from tests.cli.support import invoke, serving
from tests.integration.support import virtual
from tests.plant.support import CELL
from tests.real.support import in_real_time, posix

DRIVE = ("--baudrate", "115200", "--mks", "1")
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT] if os.name == "posix" else [signal.SIGINT]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("axis", "mks1", "status", "--port", "FOLDER", *DRIVE), 4, "as it is none. Ports of this machine"),
        (("axis", "mks1", "status", "--port", os.devnull, *DRIVE), 4, "as it is none. Ports of this machine"),
        (("axis", "mks1", "status", "--port", "", *DRIVE), 2, "--port is empty: is a variable of the shell unset?"),
        (("axis", "mks1", "status", "--port", "socket://", "--mks", "1"), 2, "names no host and port"),
        (("axis", "mks1", "status", "--port", "foo://host", "--mks", "1"), 2, "is no port"),
        (("axis", "mks1", "status", "--port", "/dev/ttyUSB0", "--mks", "248"), 2, "247"),
        (("axis", "mks1", "status", "--port", "/dev/ttyUSB0", "--mks", "0"), 2, "1"),
        (("axis", "mks1", "status", "--port", "/dev/ttyUSB0", "-b", "0", "--mks", "1"), 2, "300"),
        (("scan", "--sim", "--addresses", "1-99999999999"), 2, "outside 1..247"),
        (("scan", "--sim", "--addresses", "9-3"), 2, "the wrong way round: 3-9"),
        (("scan", "--sim", "--write", "FOLDER/nope/plant.toml"), 2, "There is no folder"),
        (("scan", "--sim", "--write", "FOLDER"), 2, "is a folder: name a file in it"),
        (("record", "FOLDER/nope/x.jsonl", "--sim"), 2, "There is no folder"),
        (("record", "FOLDER", "--sim"), 2, "is a folder: name a file in it"),
        (("sniff", "--sim", "--record", "FOLDER/nope/x.jsonl"), 2, "There is no folder"),
        (("settings", "save", "mks1", "FOLDER/nope/x.toml", "--sim"), 2, "There is no folder"),
        (("settings", "save", "mks1", "PLANT", "--sim"), 2, "is there already"),
        (("verify", "--sim", "--report", "FOLDER/nope/report.toml"), 2, "There is no folder"),
        (("plan", "PLANT", "-o", "FOLDER/nope/plan.svg"), 2, "There is no folder"),
        (("settings", "write", "mks1", "mode", "FOO", "--sim"), 1, "mode is one of CR_OPEN"),
        (("settings", "write", "mks1", "current", "99999", "--sim"), 2, "0..3000 mA"),
        (("setup", "--sim"), 2, "Nobody is there to answer: run it in a terminal, or with --yes"),
        (("verify-watchdog",), 2, "Nobody is there to answer: run it in a terminal, or with --yes"),
        (("group", "xy", "home", "--sim"), 2, 'A plant file says which there are: [groups.xy], axes = ["x", "y"].'),
        (("read", "3", "0xffff", "2", "--sim"), 2, "outside 0..65535"),
    ],
)
def test_it_is_told_what_to_do(
    arguments: tuple[str, ...], code: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())  # nobody is there
    plant = tmp_path / "plant.toml"
    plant.write_text(CELL)
    said = {"FOLDER": str(tmp_path), "PLANT": str(plant)}
    result = invoke(*(said.get(each, each.replace("FOLDER", str(tmp_path))) for each in arguments))
    assert words in result.said
    assert "Traceback" not in result.said
    assert result.returncode == code


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\x7fELF\x02\x01\x01\0\xd0\0", "is no text in UTF-8. If an editor has written it, save it as UTF-8"),
        (CELL.encode("utf-16"), "save it as UTF-8"),
        (b'# all of it\nname = "K\xe4fig"\n', "line 2: this is no UTF-8: save the file as UTF-8"),
        (b"", "there are no buses; add a table [buses.main]"),
        (b'[buses.main]\nport = "/dev/ttyUSB0"\nport = "/dev/ttyUSB1"\n', "This key was given already (at line 3"),
        (b'[buses.main]\nport = ["/dev/ttyUSB0", "/dev/ttyUSB1"]\n', "must be a text in quotes"),
        (b'[buses.main]\nport = "/dev/ttyUSB0"\nbaudrate = 9600\nconfig = 3\n', "There is:"),
        (CELL.replace("address = 1", "address = 0", 1).encode(), "0 is outside 1..247"),
        (CELL.replace("address = 1", "address = 248", 1).encode(), "248 is outside 1..247"),
        (CELL.replace('side = "left"', 'side = "middle"', 1).encode(), '"middle" is no side'),
        (None, "is a folder: name a plant file in it"),
    ],
)
@pytest.mark.parametrize("command", [("check", "PLANT"), ("axis", "x", "status", "--sim", "--plant", "PLANT")], ids=str)
def test_what_is_no_plant_file_is_told(
    command: tuple[str, ...], content: bytes | None, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "plant.toml"
    path.mkdir() if content is None else path.write_bytes(content)
    result = invoke(*(str(path) if each == "PLANT" else each for each in command))
    assert words in result.said
    assert result.returncode == 2


def test_check_takes_the_plant_file_of_this_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke("check")
    assert "There is no plant file plant.toml. rs485bus scan PORT --write plant.toml makes one" in result.said
    assert result.returncode == 2
    (tmp_path / "plant.toml").write_text(CELL)
    assert "plant.toml is right: cell, 4 axes on 1 bus, 1 group, a vehicle." in invoke("check").said


@pytest.mark.parametrize("ending", ["\r\n", "\r"])
def test_a_plant_file_of_an_editor_on_windows_is_read(ending: str, tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    path.write_bytes(b"\xef\xbb\xbf" + CELL.replace("\n", ending).encode())
    assert invoke("check", str(path)).returncode == 0


@posix
def test_an_address_that_a_drive_of_another_family_has_is_taken() -> None:
    with serving(SimMks(1), SimTlr(4)) as port:
        result = invoke("setup", port, "--yes", "--address", "1", "-b", "115200", "--new-address", "4")
    assert "Somebody answers at address 4 already" in result.said
    assert result.returncode == 1


# Questions


@pytest.mark.parametrize("number", SIGNALS)
def test_any_signal_ends_a_question(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("typer.confirm", lambda question: signal.raise_signal(number))
    result = invoke("settings", "write", "tlr3", "input_filter", "3", "--sim")
    assert "Interrupted." in result.said
    assert result.returncode == 130


def test_a_number_that_it_cannot_be_is_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([300, 7, 12, 57600])
    monkeypatch.setattr("typer.prompt", lambda *arguments, **options: next(answers))
    monkeypatch.setattr("typer.confirm", lambda question: "Change its address from 1 to 7" not in question)
    result = invoke("setup", "--sim")
    assert "MKS SERVO drives have addresses 1..247, not 300." in result.said
    assert "bit/s, not 12." in result.said
    assert "It was left as it is. Nothing more was changed." in result.said


# Interruptions


@virtual
async def test_who_is_interrupted_is_told_where_the_motor_stands(capsys: pytest.CaptureFixture[str]) -> None:
    running = asyncio.ensure_future(run_order(Where(sim=True), "mks1", Order(verb="move-to", value=100.0), True))
    await asyncio.sleep(2)
    running.cancel()
    with pytest.raises(asyncio.CancelledError) as cancelled:
        await running
    (note,) = cancelled.value.__notes__
    assert note.startswith("Interrupted. mks1 stands at ")
    assert json.loads(capsys.readouterr().out)["message"] == note


@posix
@pytest.mark.parametrize("number", [signal.SIGQUIT, signal.SIGTSTP])
def test_what_a_terminal_can_do_to_a_command_stops_its_motors(number: signal.Signals) -> None:
    """A command that was suspended or dumped its core would leave a motor turning that has no watchdog."""

    async def turns() -> int:
        signal.raise_signal(number)
        await asyncio.sleep(5)
        return 0

    assert process.run(turns) == process.INTERRUPTED


# Streams that are closed, full, or nobody's


@posix
@pytest.mark.parametrize("closed", ["<&- >&- 2>&-", "2>/dev/full"])
def test_the_exit_code_holds_whatever_becomes_of_the_streams(closed: str) -> None:
    script = f"exec {sys.executable} -m rs485bus axis mks1 status --port /dev/ttyNOPE -b 9600 --mks 1 {closed}"
    result = subprocess.run(("bash", "-c", script), capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 4
    assert "Traceback" not in result.stderr


def test_a_command_without_streams_does_what_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    monkeypatch.setattr("sys.argv", ["rs485bus", "check", "/nope.toml"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        stream.close()


@posix
def test_an_encoding_without_all_characters_ends_no_command() -> None:
    command = (sys.executable, "-m", "rs485bus", "settings", "read", "zlac4.left", "--sim")
    result = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    assert result.returncode == 0, result.stderr
    assert "drive_temperature_limit" in result.stdout


def test_a_full_disk_is_told_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert process.tell(OSError(errno.ENOSPC, "No space left on device")) == 1
    assert "the output cannot be written: No space left on device" in capsys.readouterr().err


# Rights


@posix
def test_somebody_without_rights_is_told_which_group_to_join() -> None:
    """As root this drops its rights once all is loaded: what is installed may be root's own."""
    script = (
        "import os, sys, serial_asyncio\n"
        "from rs485bus.cli.app import main\n"
        "try: main(['axis', 'mks1', 'status', '--sim'])\n"
        "except SystemExit: pass\n"
        "if os.getuid() == 0: os.setgroups([]); os.setresgid(65534, 65534, 65534); os.setresuid(65534, 65534, 65534)\n"
        "main(sys.argv[1:])\n"
    )

    async def main() -> None:
        async with await VirtualLine(SimMks(1), baudrate=115200).serve_pty() as port:
            os.chmod(port.path, 0)
            there = ("axis", "mks1", "status", "--port", port.path, *DRIVE)
            result = await asyncio.to_thread(
                subprocess.run, (sys.executable, "-c", script, *there), capture_output=True, text=True, check=False
            )
        assert f"PortPermissionDenied: You may not open {port.path}. Only " in result.stderr
        assert f"sudo chmod g+rw {port.path}" in result.stderr
        assert "sudo usermod -aG dialout $USER" in result.stderr
        assert result.returncode == 4

    in_real_time(main)


@posix
def test_how_to_be_allowed_is_said_for_the_group_that_has_the_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import grp
    import pwd
    from types import SimpleNamespace

    me = pwd.getpwuid(os.getuid()).pw_name
    members: list[str] = []
    monkeypatch.setattr(grp, "getgrgid", lambda number: SimpleNamespace(gr_name="uucp", gr_mem=members))
    device = os.stat_result((stat.S_IFCHR | 0o660, 0, 0, 1, 0, 4711, 0, 0, 0, 0))
    monkeypatch.setattr(os, "stat", lambda path: device)
    assert "sudo usermod -aG uucp $USER" in how_to_be_allowed("/dev/ttyUSB0")
    members.append(me)
    assert "since you logged in: log out, and in again" in how_to_be_allowed("/dev/ttyUSB0")


@posix
def test_who_holds_a_port_is_told_how_to_stop_its_motors() -> None:
    with serving(SimMks(1)) as port:
        held = serial.Serial(port, exclusive=True)
        try:
            result = invoke("estop", "--port", port, *DRIVE)
        finally:
            held.close()
    assert f"PortBusy: {port} is in use by" in result.said
    assert "interrupt it there, by Ctrl-C or kill -INT and its number" in result.said
    assert result.returncode == 4


@posix
def test_a_port_of_sim_that_another_one_has_made_anew_is_left_alone(tmp_path: Path) -> None:
    async def main() -> None:
        link = tmp_path / "port"
        first = await VirtualLine(SimMks(1)).serve_pty(link)
        async with await VirtualLine(SimMks(2)).serve_pty(link) as second:
            await first.aclose()
            assert str(link.readlink()) == second.path
        assert not link.is_symlink()

    in_real_time(main)
