"""`rs485bus tune`: what is measured stands in the plant file."""

import tomllib
from pathlib import Path

import pytest

from tests.cli.support import invoke
from tests.plant.support import CELL


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    path = tmp_path / "plant.toml"
    path.write_text(CELL)
    return path


def test_what_was_measured_is_written_into_the_plant_file(cell: Path) -> None:
    result = invoke("tune", "--plant", str(cell), "--sim", "--no-rates")
    assert result.returncode == 0, result.said
    plant = tomllib.loads(cell.read_text())
    assert plant["axes"]["x"]["reply_timeout"] == 0.03
    assert "the longest answer began after 2.0 ms" in cell.read_text()
    assert plant["buses"]["main"]["baudrate"] == 115200
    assert invoke("check", str(cell)).returncode == 0


def test_a_higher_rate_is_tried_only_where_somebody_agrees(cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr("typer.confirm", lambda question: bool(asked.append(question)))
    there = ("--mks", "1", "--port", "/dev/x", "--baudrate", "9600", "--sim")
    assert invoke("tune", *there, "--no-write").returncode == 0
    assert asked == ["Set all drives of this pair to 19200 bit/s, which each keeps, and try that?"]


def test_drives_are_set_to_the_highest_rate_that_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    path.write_text('[buses.main]\nport = "COM3"\nbaudrate = 9600\n[axes.x]\nfamily = "mks"\naddress = 1\n')
    result = invoke("tune", "--plant", str(path), "--sim", "--yes")
    assert result.returncode == 0, result.said
    assert tomllib.loads(path.read_text())["buses"]["main"]["baudrate"] == 256000
    assert "nothing was lost" in path.read_text()
    assert invoke("tune", "--bus", "mian", "--plant", str(path), "--sim").returncode == 2
