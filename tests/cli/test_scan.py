"""`rs485bus scan`, as a user runs it."""

import asyncio
import json
from pathlib import Path

import pytest

from rs485bus.plant import PlantFile
from rs485bus.sim import SimMks, SimTlr, VirtualLine
from tests.cli.test_cli import call
from tests.real.support import in_real_time, posix


def said(text: str) -> str:
    return " ".join(text.split())


@posix
def test_scanning_a_port_in_real_time_finds_its_drives_and_writes_the_first_plant_file(tmp_path: Path) -> None:
    async def main() -> None:
        line = VirtualLine(SimMks(3), SimTlr(5), baudrate=115200)
        path = tmp_path / "plant.toml"
        async with await line.serve_pty() as port:
            arguments = ("scan", port.path, "-b", "115200", "--addresses", "1-8", "--json", "--write", str(path))
            result = await asyncio.to_thread(call, *arguments)
        assert result.returncode == 0, result.stderr
        found = json.loads(result.stdout)
        assert [(one["address"], one["family"], one["baudrate"]) for one in found] == [
            (3, "mks", 115200),
            (5, "tlr", 115200),
        ]
        assert PlantFile.load(path).buses["main"].port == port.path

    in_real_time(main)


def test_virtual_drives_are_scanned_without_a_port() -> None:
    result = call("scan", "--sim", "-b", "115200", "--addresses", "1-5")
    assert result.returncode == 0
    assert "ZLAC8015D" in result.stdout


def test_a_plant_file_that_is_there_is_not_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    path.write_text("mine")
    result = call("scan", "--sim", "-b", "115200", "--addresses", "1-2", "--write", str(path))
    assert result.returncode == 2
    assert "is there already" in result.stderr
    assert path.read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("scan",), 2, "Say which port"),
        (("scan", "/dev/ttyNOPE"), 4, "There is no port /dev/ttyNOPE"),
        (("scan", "192.168.1.5"), 1, "socket://192.168.1.5:4196"),
        (("scan", "--sim", "--addresses", "0-5"), 2, "outside 1..247"),
        (("scan", "--sim", "--format", "7E1"), 1, "none of 8N1, 8E1, 8O1, 8N2"),
        (("scan", "--sim", "-b", "9600", "--addresses", "1-2"), 1, "A and B, which may be swapped"),
    ],
)
def test_what_is_wrong_is_told_with_what_to_do(arguments: tuple[str, ...], code: int, words: str) -> None:
    result = call(*arguments)
    assert words in said(result.stdout + result.stderr)
    assert result.returncode == code
    assert "Traceback" not in result.stderr
