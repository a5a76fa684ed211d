"""What a plan says, and that the simulation says the same."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rs485bus.cli.app import app
from rs485bus.planning import PairPlan, plan
from rs485bus.planning.checking import check
from rs485bus.planning.plan import BAUDRATES, at_baudrate, most_drives, with_drives
from rs485bus.plant import PlantFile

CELL = """
name = "cell"

[buses.main]
port = "/dev/ttyUSB0"
baudrate = 38400

[axes.x]
bus = "main"
family = "mks"
address = 1
watchdog = 1.0
limits = [0.0, 10.0]

[axes.y]
bus = "main"
family = "tlr"
address = 5

[axes.left]
bus = "main"
family = "zlac"
address = 3
side = "left"
watchdog = 1.0

[axes.right]
bus = "main"
family = "zlac"
address = 3
side = "right"
watchdog = 1.0
"""


def cell() -> tuple[PairPlan, PlantFile]:
    file = PlantFile.loads(CELL)
    (pair,) = plan(file)
    return pair, file


def some_plant(rng: random.Random) -> PlantFile:
    """A plant of up to seven drives, some of them guarded."""
    lines = ['name = "random"', "[buses.main]", 'port = "/dev/ttyUSB0"']
    lines.append(f"baudrate = {rng.choice([19200, 38400, 57600, 115200])}")
    base = rng.choice([1.0, 2.0, 3.0])
    for at, address in enumerate(rng.sample(range(1, 100), rng.randint(1, 7))):
        family = rng.choice(["mks", "tlr", "zlac"])
        guarded = family != "tlr" and rng.random() < 0.8
        for side in ("left", "right") if family == "zlac" else ("",):
            lines += [f"[axes.a{at}{side}]", 'bus = "main"', f'family = "{family}"', f"address = {address}"]
            lines += [f'side = "{side}"'] if side else []
            lines += [f"watchdog = {base * (1 + at % 3 / 2):g}"] if guarded else []
    return PlantFile.loads("\n".join(lines))


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 5, 7, 9, 16, 17, 19])  # each kind of plant, few drives as a rule
def test_it_agrees_with_the_simulation_within_three_percent(seed: int) -> None:
    rng = random.Random(seed)
    file = some_plant(rng)
    (pair,) = plan(file, turnaround=rng.uniform(0.0005, 0.006))
    compared = check(pair, file)
    assert len(compared) >= 3
    assert [one for one in compared if one.off > 0.03] == []
    assert all(one.agrees for one in compared)
    assert pair.stop_wait >= pair.stop_wait_behind_positions


def test_a_transaction_takes_its_bytes_the_turnaround_and_the_silence() -> None:
    pair, _ = cell()
    frame = pair.drives[0].positions[0]
    assert (frame.request, frame.reply) == (8, 11)
    assert pair.takes(frame) == pytest.approx(19 * 10 / 38400 + 0.002 + 0.00175)


def test_limits_do_not_keep_a_drive_from_being_learned() -> None:
    pair, _ = cell()
    assert [drive.address for drive in pair.drives] == [1, 5, 3]
    assert all(drive.stops for drive in pair.drives)


def test_a_drive_answers_no_sooner_than_it_knows_that_the_request_is_over() -> None:
    (pair,) = plan(PlantFile.loads(CELL.replace("38400", "9600")), turnaround=0.0)
    assert pair.answers_after == pytest.approx(3.5 * 11 / 9600)


def test_watchdogs_that_cannot_be_fed_do_not_fit_and_the_bus_says_why() -> None:
    (pair,) = plan(PlantFile.loads(CELL.replace("watchdog = 1.0", "watchdog = 0.3")))
    assert not pair.fits
    assert "cannot be fed in time" in pair.problem
    assert min(margin for drive in pair.drives if (margin := pair.margin(drive)) is not None) < 0


def test_it_says_where_it_stops_fitting() -> None:
    (pair,) = plan(file := PlantFile.loads(CELL.replace("watchdog = 1.0", "watchdog = 0.6")))
    assert pair.fits
    most = most_drives(pair, file)
    assert 3 <= most < 31
    assert with_drives(pair, file, most).fits
    assert not with_drives(pair, file, most + 1).fits
    fitting = [at_baudrate(pair, file, baudrate).fits for baudrate in BAUDRATES]
    assert fitting == sorted(fitting)
    assert fitting[-1]


def test_the_command_tells_it_and_draws_it(tmp_path: Path) -> None:
    path, picture = tmp_path / "plant.toml", tmp_path / "plan.svg"
    path.write_text(CELL)
    result = CliRunner().invoke(app, ["plan", str(path), "-o", str(picture), "--check"])
    assert result.exit_code == 0, result.output
    for said in ("3 drives at 38400 bit/s", "a stop waits", "set-points", "it fits       yes", "460800", "agrees"):
        assert said in result.stdout
    assert "DIFFERS" not in result.stdout
    assert max(map(len, result.stdout.split("all positions")[0].splitlines())) <= 80
    assert picture.stat().st_size > 5000


def test_the_command_for_programs_and_with_a_plant_that_does_not_fit(tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    path.write_text(CELL.replace("watchdog = 1.0", "watchdog = 0.3"))
    result = CliRunner().invoke(app, ["plan", str(path), "--json"])
    assert result.exit_code == 1
    told = json.loads(result.stdout)
    assert told["fits"] is False
    assert "cannot be fed in time" in told["buses"][0]["problem"]
    assert {"position_rate", "stop_wait", "most_drives", "drives"} <= told["buses"][0].keys()
