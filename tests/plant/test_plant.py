"""A plant that is open, on virtual drives and the virtual clock."""

from pathlib import Path

import pytest

import rs485bus
from rs485bus import AxisGroup, MksServo, Plant, TlrStepper
from rs485bus.plant import PlantFile, PlantFileError
from rs485bus.sim import SimMks
from tests.integration.support import virtual
from tests.plant.support import CELL


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    path = tmp_path / "plant.toml"
    path.write_text(CELL)
    return path


@virtual
async def test_a_plant_is_opened_by_its_file_and_knows_its_axes_by_name(cell: Path) -> None:
    async with Plant.load(cell, sim=True) as plant:
        assert isinstance(plant.x, MksServo)
        assert isinstance(plant.y, TlrStepper)
        assert plant.axes["x"] is plant.axes.x is plant.x
        assert plant.left.name.startswith("ZLAC")
        assert isinstance(plant.groups.xy, AxisGroup)
        assert plant.xy is plant.groups["xy"]
        assert plant.buses.main is plant.x.bus
        assert plant.vehicle is not None
        plant.x.enable()
        plant.y.enable()
        assert await plant.x.home() == 0.0
        await plant.y.home()
        assert await plant.xy.move_to(x=16.0, y=1.0) == {"x": pytest.approx(16.0, abs=0.1), "y": pytest.approx(1.0)}
    assert plant.x.bus.closed


@virtual
async def test_axes_with_a_watchdog_are_guarded_while_the_plant_is_open(cell: Path) -> None:
    plant = Plant.load(cell, sim=True)
    (line,) = plant.lines.values()
    drive = next(device for device in line.pair.devices if isinstance(device, SimMks))  # type: ignore[attr-defined]
    async with plant:
        assert drive.watchdog_ms == 1000
        plant.x.enable()
        plant.x.move_to(8.0)  # it ends before the watchdog is let go
    assert drive.watchdog_ms == 0
    assert drive.trips == []


@virtual
async def test_what_only_looks_arms_no_watchdog(cell: Path) -> None:
    plant = Plant.load(cell, sim=True, watchdogs=False)
    (line,) = plant.lines.values()
    drive = next(device for device in line.pair.devices if isinstance(device, SimMks))  # type: ignore[attr-defined]
    async with plant:
        assert await plant.x.position() == 0.0
        assert drive.watchdog_ms == 0


@virtual
async def test_an_emergency_stop_of_the_plant_stops_every_drive(cell: Path) -> None:
    async with Plant.load(cell, sim=True) as plant:
        plant.x.enable()
        run = plant.x.run(100)
        await run
        reports = await plant.emergency_stop()
        assert reports["main"].all_standing
        assert len(reports["main"].devices) == 3


@virtual
async def test_a_name_that_is_not_there_is_told_with_what_there_is(cell: Path) -> None:
    plant = Plant.load(cell, sim=True)
    with pytest.raises(AttributeError, match="async with plant"):
        plant.x  # noqa: B018
    async with plant:
        with pytest.raises(AttributeError, match=r"Did you mean .right."):
            plant.rigt  # noqa: B018
        with pytest.raises(KeyError, match="Did you mean"):
            plant.axes["lefft"]


@virtual
async def test_a_mistake_that_only_the_facade_knows_closes_the_buses_again(tmp_path: Path) -> None:
    plant = Plant(PlantFile.loads(CELL.replace("units_per_turn = 8.0", "units_per_turn = -8.0")), sim=True)
    with pytest.raises(PlantFileError, match="units_per_turn must be"):
        async with plant:
            raise AssertionError


def test_a_subclass_that_names_its_axes_is_compared_with_the_file(cell: Path) -> None:
    class Right(Plant):
        x: MksServo
        y: TlrStepper

    class Wrong(Plant):
        x: TlrStepper
        z: MksServo

    assert Right.load(cell).name == "cell"
    with pytest.raises(PlantFileError, match="Wrong has an axis z") as caught:
        Wrong.load(cell)
    assert "says that x is a TlrStepper" in str(caught.value)


def test_a_missing_plant_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(PlantFileError, match="rs485bus scan PORT --write"):
        Plant.load(tmp_path / "plant.toml")


def test_the_package_knows_the_plant_and_loads_it_when_it_is_asked_for() -> None:
    assert rs485bus.Plant is Plant
    assert rs485bus.plant.Plant is Plant
