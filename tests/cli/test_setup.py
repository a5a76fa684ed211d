"""`rs485bus setup`, as a user runs it."""

import signal
import subprocess
import sys

import pytest
import typer

from rs485bus.cli import process
from rs485bus.sim import SimMks
from tests.cli.support import invoke, serving
from tests.real.support import posix


@posix
def test_a_drive_gets_its_address_in_real_time() -> None:
    sim = SimMks(1)
    with serving(sim, baudrate=38400) as port:
        result = invoke("setup", port, "-b", "38400", "--address", "1", "--new-address", "4", "--yes")
    assert result.returncode == 0, result.said
    assert "Done: address 4 at 38400 bit/s. Write it on the drive." in result.said
    assert sim.address == 4


@posix
@pytest.mark.parametrize("rate", [115200, 256000])
def test_a_drive_gets_another_baud_rate_in_real_time(rate: int) -> None:
    sim = SimMks(1)
    with serving(sim, baudrate=38400) as port:
        result = invoke("setup", port, "-b", "38400", "--address", "1", "--new-baudrate", str(rate), "--yes")
        assert result.returncode == 0, result.said
        assert invoke("scan", port, "-b", str(rate), "--addresses", "1").returncode == 0
        assert invoke("scan", port, "-b", "38400", "--addresses", "1").returncode != 0
    assert sim.baudrate == rate


def test_each_change_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def confirm(question: str) -> bool:
        asked.append(question)
        return "baud rate" not in question

    monkeypatch.setattr(typer, "confirm", confirm)
    monkeypatch.setattr(typer, "prompt", lambda question, default, type: 9 if "address" in question else default)  # noqa: A006
    result = invoke("setup", "--sim")
    assert result.returncode == 1
    assert asked == [
        "Is the drive alone on the virtual pair, and does its motor stand?",
        "Change its address from 1 to 9?",
        "Change its baud rate from 38400 to 115200?",
    ]
    assert "It was left as it is. Nothing more was changed." in result.said


def test_an_interrupted_question_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(question: str) -> bool:
        raise typer.Abort

    monkeypatch.setattr(typer, "confirm", interrupted)
    result = invoke("setup", "--sim")
    assert (result.returncode, result.stderr) == (process.INTERRUPTED, "Interrupted.\n")


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("setup",), 2, "Say which port"),
        (("setup", "--sim", "--yes"), 2, "nobody is asked"),
        (("setup", "--sim", "--yes", "--new-baudrate", "1200"), 1, "MKS SERVO drives have 9600"),
        (("setup", "--sim", "--yes", "-b", "9600", "--address", "3", "--new-address", "5"), 1, "--modbus-on"),
        (("setup", "/dev/ttyNOPE", "--yes", "--new-address", "5", "-b", "9600"), 4, "There is no port"),
    ],
)
def test_what_is_wrong_is_told_with_what_to_do(arguments: tuple[str, ...], code: int, words: str) -> None:
    result = invoke(*arguments)
    assert words in result.said
    assert result.returncode == code
    assert "Traceback" not in result.stderr


@posix
def test_an_interrupted_setup_says_where_the_drive_may_be_in_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    sim = SimMks(1)
    receive, told = sim.receive, list[bytes]()

    def interrupt(frame: bytes, now: float) -> bytes | None:
        answer = receive(frame, now)
        if sim.baudrate != 38400 and not told:  # before its answer is there: however busy the computer is
            told.append(frame)
            running.send_signal(signal.SIGINT)
        return answer

    monkeypatch.setattr(sim, "receive", interrupt)
    with serving(sim, baudrate=38400) as port:
        command = (sys.executable, "-m", "rs485bus", "setup", port, "-b", "38400", "--address", "1", "--yes")
        with subprocess.Popen((*command, "--new-baudrate", "115200"), stderr=subprocess.PIPE, text=True) as running:
            said = running.communicate(timeout=30)[1]
    assert told
    assert running.returncode == process.INTERRUPTED
    assert "address 1 at 38400 bit/s, or address 1 at 115200 bit/s. Look at both." in said
    assert "Interrupted. No more was changed than is said here." in said
