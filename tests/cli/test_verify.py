"""`rs485bus verify`: questions, options in the plant file, and a report."""

import tomllib
from pathlib import Path

import pytest

from tests.cli.support import invoke
from tests.plant.support import CELL


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    path = tmp_path / "plant.toml"
    path.write_text("# mine\n" + CELL)
    return path


def test_what_was_found_is_written_into_the_plant_file_and_reported(cell: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.toml"
    result = invoke("verify", "x", "left", "--plant", str(cell), "--sim", "--yes", "--report", str(report))
    assert result.returncode == 0, result.said
    text = cell.read_text()
    assert text.startswith("# mine\n")
    axes = tomllib.loads(text)["axes"]
    assert axes["x"]["microsteps"] == 16
    assert axes["left"]["status_word_left"] == "low"
    assert "enabled_bit" not in axes["y"]
    assert 'positive = "CCW" # verified 20' in text
    told = tomllib.loads(report.read_text())["drives"]
    assert [one["drive"]["family"] for one in told] == ["mks", "zlac"]
    assert told[0]["answers"][-1]["measured"] == {"trips": True, "fed_by": ["reads"], "latches": False}
    assert invoke("check", str(cell)).returncode == 0


def test_each_drive_is_asked_for_before_anything_moves(cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr("typer.confirm", lambda question: bool(asked.append(question)))
    before = cell.read_text()
    result = invoke("verify", "--plant", str(cell), "--sim")
    assert result.returncode == 1
    assert asked == ["Is it free to turn, and does nothing hang on its shaft that may fall?"] * 3
    assert "MKS SERVO 1 (x) was left alone." in result.said
    assert cell.read_text() == before


def test_one_question_is_asked_alone_and_its_option_is_told(cell: Path) -> None:
    result = invoke("verify", "tlr3", "--only", "block writes", "--sim")
    assert result.returncode == 0
    assert "For its table in a plant file: block_writes = true" in result.said
    result = invoke("verify", "tlr3", "--only", "colour", "--sim")
    assert result.returncode == 2
    assert "There is no question 'colour' for this family. There is: enabled bit" in result.said
