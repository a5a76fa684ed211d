"""`rs485bus group`: axes that move together, on the virtual clock."""

import json
from pathlib import Path

import pytest

from rs485bus.cli.group import VERBS, GroupOrder, run_group
from rs485bus.cli.process import WrongUse
from rs485bus.cli.session import Where
from rs485bus.errors import LimitExceeded
from tests.cli.support import invoke
from tests.integration.support import virtual
from tests.plant.support import CELL


@pytest.fixture
def cell(tmp_path: Path) -> Where:
    path = tmp_path / "plant.toml"
    path.write_text(CELL)
    return Where(plant=path, sim=True)


@pytest.mark.parametrize(
    ("verb", "values", "x", "y"),
    [
        ("move-to", [16.0, -1.0], 16.0, -1.0),
        ("move-by", [-8.0, 0.5], -8.0, 0.5),
        ("home", [], 0.0, 0.0),
        ("enable", [], 0.0, 0.0),
        ("stop", [], 0.0, 0.0),
        ("zero", [], 0.0, 0.0),
        ("disable", [], 0.0, 0.0),
        ("status", [], 0.0, 0.0),
    ],
)
@virtual
async def test_each_verb_is_carried_out_and_told(
    verb: str, values: list[float], x: float, y: float, cell: Where, capsys: pytest.CaptureFixture[str]
) -> None:
    assert await run_group(cell, "xy", GroupOrder(verb=verb, values=values), True) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["positions"]["x"] == {"position": pytest.approx(x, abs=0.02), "unit": "mm"}
    assert told["positions"]["y"]["position"] == pytest.approx(y, abs=0.01)
    assert ("skew_ms" in told) is verb.startswith("move")


@virtual
async def test_a_failure_is_told_to_programs_too(cell: Where, capsys: pytest.CaptureFixture[str]) -> None:
    order = GroupOrder(verb="move-to", values=[500.0, 0.0])
    assert await run_group(cell, "xy", order, True) == 2
    assert json.loads(capsys.readouterr().out)["error"] == "LimitExceeded"
    with pytest.raises(LimitExceeded):
        await run_group(cell, "xy", order, False)


@pytest.mark.parametrize(
    ("name", "order", "words"),
    [
        ("yx", GroupOrder(verb="home"), "no group 'yx'"),
        ("xy", GroupOrder(verb="hom"), "no verb 'hom'"),
        ("xy", GroupOrder(verb="move-to", values=[1.0]), "takes 2 numbers, for x, y; 1 were given"),
        ("xy", GroupOrder(verb="home", values=[1.0]), "takes no number"),
        ("xy", GroupOrder(verb="stop", rpm=3.0), "neither --rpm nor --duration"),
    ],
)
@virtual
async def test_what_cannot_be_meant_is_refused(name: str, order: GroupOrder, words: str, cell: Where) -> None:
    with pytest.raises(WrongUse, match=words):
        await run_group(cell, name, order, False)


def test_negative_positions_are_numbers_and_every_verb_is_in_the_help(cell: Where) -> None:
    result = invoke("group", "xy", "move-to", "-8", "-0.5", "--plant", str(cell.plant), "--sim")
    assert result.returncode == 0, result.said
    assert "x: -8 mm y: -0.5 turns They started within" in result.said
    said = invoke("group", "--help").said
    assert all(verb in said for verb in VERBS)
