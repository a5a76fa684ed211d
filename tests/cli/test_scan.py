"""`rs485bus scan`, as a user runs it."""

import errno
import json
from pathlib import Path

import pytest

from rs485bus.plant import PlantFile
from rs485bus.sim import SimMks, SimTlr
from tests.cli.support import invoke, serving
from tests.real.support import posix


@posix
def test_scanning_a_port_in_real_time_finds_its_drives_and_writes_the_first_plant_file(tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    with serving(SimMks(3), SimTlr(5)) as port:
        result = invoke("scan", port, "-b", "115200", "--addresses", "1-8", "--json", "--write", str(path))
    assert result.returncode == 0, result.said
    assert [(one["address"], one["family"], one["baudrate"]) for one in json.loads(result.stdout)] == [
        (3, "mks", 115200),
        (5, "tlr", 115200),
    ]
    assert PlantFile.load(path).buses["main"].port == port


def test_virtual_drives_are_scanned_without_a_port() -> None:
    result = invoke("scan", "--sim", "-b", "115200", "--addresses", "1-5")
    assert result.returncode == 0
    assert "ZLAC8015D" in result.stdout


def test_a_plant_file_that_is_there_is_not_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    path.write_text("mine")
    result = invoke("scan", "--sim", "-b", "115200", "--addresses", "1-2", "--write", str(path))
    assert result.returncode == 2
    assert "is there already" in result.stderr
    assert path.read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("scan",), 2, "Say which port"),
        (("scan", "/dev/ttyNOPE"), 4, "There is no port /dev/ttyNOPE"),
        (("scan", "192.168.1.5"), 2, "socket://192.168.1.5:4196"),
        (("scan", "--sim", "--addresses", "0-5"), 2, "outside 1..247"),
        (("scan", "--sim", "--format", "7E1"), 2, "none of 8N1, 8E1, 8O1, 8N2"),
        (("scan", "--sim", "-b", "9600", "--addresses", "1-2"), 1, "A and B, which may be swapped"),
    ],
)
def test_what_is_wrong_is_told_with_what_to_do(arguments: tuple[str, ...], code: int, words: str) -> None:
    result = invoke(*arguments)
    assert words in result.said
    assert result.returncode == code
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    "command",
    [
        ("scan", "/dev/ttyUSB0", "-b", "9600"),
        ("axis", "mks1", "status", "-b", "9600", "--mks", "1", "--port", "/dev/ttyUSB0"),
        ("read", "1", "5", "-b", "9600", "--port", "/dev/ttyUSB0"),
    ],
)
def test_a_port_that_may_not_be_opened_names_the_group_to_join(
    command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*arguments: object, **settings: object) -> None:
        raise OSError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("rs485bus.transport.serial._Port", refused)
    result = invoke(*command)
    assert result.returncode == 4
    assert "You may not open /dev/ttyUSB0." in result.said
    assert "sudo usermod -aG dialout" in result.said
