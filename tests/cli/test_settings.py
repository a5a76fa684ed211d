"""`rs485bus settings`: what a drive is set to, as a file, on the virtual clock."""

import json
import tomllib
from pathlib import Path

import pytest

from rs485bus.bench.drive_settings import differences
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine
from tests.cli.support import invoke


@pytest.fixture
def drives(monkeypatch: pytest.MonkeyPatch) -> dict[str, SimMks | SimTlr | SimZlac]:
    """The same virtual drives in each command."""
    made = {"mks": SimMks(1), "tlr": SimTlr(3), "zlac": SimZlac(4)}

    def lines(file: object) -> dict[str, VirtualLine]:
        return {"main": VirtualLine(*made.values())}

    monkeypatch.setattr("rs485bus.plant.plant.virtual_lines", lines)
    return made


def settings(*arguments: str) -> tuple[int, str]:
    result = invoke("settings", *arguments, "--sim")
    assert "Traceback" not in result.said
    return result.returncode, result.said


@pytest.mark.parametrize(
    ("name", "setting", "other"),
    [
        ("tlr3", "input_filter", 7),
        ("zlac4.left", "maximum_motor_speed", 777),
        ("zlac4.right", "left_rated_current", 9.5),
    ],
)
def test_settings_are_saved_compared_and_loaded(
    name: str, setting: str, other: float, tmp_path: Path, drives: dict[str, SimMks | SimTlr | SimZlac]
) -> None:
    path = tmp_path / "drive.toml"
    assert settings("save", name, str(path))[0] == 0
    before = tomllib.loads(path.read_text())["settings"][setting]
    assert settings("diff", name, str(path)) == (0, f"{name} is set as {path} says.")
    path.write_text(path.read_text().replace(f"\n{setting} = {before}", f"\n{setting} = {other}"))
    code, said = settings("diff", name, str(path))
    assert code == 1
    assert f"{setting}: file {other:g}, drive {before:g}" in said
    code, said = settings("load", name, str(path), "--yes")
    assert code == 0, said
    assert settings("diff", name, str(path))[0] == 0
    drive = drives[name[: name.index("3" if "3" in name else "4")]]
    assert not isinstance(drive, SimMks)
    drive.power_cycle(990.0)  # it keeps it
    code, said = settings("read", name, setting, "--json")
    assert json.loads(said) == {setting: other}


def test_what_an_mks_drive_acknowledged_is_kept_in_the_file(
    tmp_path: Path, drives: dict[str, SimMks | SimTlr | SimZlac]
) -> None:
    path = tmp_path / "mks.toml"
    code, said = settings("save", "mks1", str(path))
    assert code == 0
    assert "cannot be asked" in said
    text = path.read_text()
    for name in ("mode", "current", "homing", "vfoc_gains", "holding_current"):
        text = text.replace(f"# {name} =", f"{name} =")
    path.write_text(text.replace('mode = "SR_VFOC"', 'mode = "SR_CLOSE"').replace("current = 1600", "current = 1200"))
    code, said = settings("diff", "mks1", str(path))
    assert code == 1
    assert "current: file 1200, acknowledged nothing" in said
    code, said = settings("load", "mks1", str(path), "--yes")
    assert code == 0, said
    assert settings("diff", "mks1", str(path)) == (0, f"mks1 is set as {path} says, as far as it acknowledged.")
    drive = drives["mks"]
    assert isinstance(drive, SimMks)
    assert drive.settings[0x83] == 1200
    code, said = settings("read", "mks1")
    assert code == 1
    assert "cannot be asked for its settings" in said


def test_one_setting_is_written_after_a_question(
    monkeypatch: pytest.MonkeyPatch, drives: dict[str, SimMks | SimTlr | SimZlac]
) -> None:
    asked: list[str] = []
    monkeypatch.setattr("typer.confirm", lambda question: bool(asked.append(question)))
    assert settings("write", "tlr3", "subdivision", "8000") == (1, "Nothing was changed.")
    assert asked == ["Change subdivision of tlr3 from 4000 to 8000? The drive keeps it."]
    assert settings("write", "tlr3", "subdivision", "8000", "--yes") == (0, "subdivision is 8000.")
    assert settings("write", "tlr3", "subdivision", "8000", "--yes") == (0, "subdivision is 8000 already.")
    assert settings("write", "tlr3", "function_of_di3", "STOP", "--yes") == (0, "function_of_di3 is STOP.")


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("write", "tlr3", "input_filtre", "5", "--yes"), 1, 'Did you mean "input_filter"'),
        (("write", "tlr3", "input_filter", "5000", "--yes"), 2, "outside 0..1024"),
        (("write", "tlr3", "function_of_di3", "HALT", "--yes"), 1, "is one of NONE, ORIGIN"),
        (("write", "zlac4.left", "parking_mode", "3", "--yes"), 1, "is true or false, not 3"),
        (("write", "mks1", "mode", "3", "--yes"), 0, "the drive has acknowledged it"),
        (("write", "mks1", "vfoc_gains", "3", "--yes"), 1, "is a table with kp, ki, kd, kv"),
        (("write", "mks1", "homing", '{kind = "wall"}', "--yes"), 1, 'kind = "switch"'),
        (("load", "mks1", "nope.toml"), 2, "There is no file nope.toml"),
        (("read", "mks9"), 2, "There is no axis 'mks9'"),
    ],
)
def test_what_is_wrong_is_told_with_what_to_do(
    arguments: tuple[str, ...], code: int, words: str, drives: dict[str, SimMks | SimTlr | SimZlac]
) -> None:
    ended, said = settings(*arguments)
    assert words in said
    assert ended == code


def test_a_file_of_another_family_is_refused(tmp_path: Path, drives: dict[str, SimMks | SimTlr | SimZlac]) -> None:
    path = tmp_path / "tlr.toml"
    assert settings("save", "tlr3", str(path))[0] == 0
    code, said = settings("load", "mks1", str(path), "--yes")
    assert code == 1
    assert "holds settings of the family tlr, and the drive is of mks" in said


def test_values_are_compared_as_people_mean_them() -> None:
    assert differences({"a": 1.0, "b": {"x": 1}}, {"a": 1, "b": {"x": 1, "y": 2}}) == {}
    assert differences({"a": 1.0, "b": 2}, {"a": 1.1}) == {"a": (1.0, 1.1), "b": (2, None)}
