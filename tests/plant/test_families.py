"""A family of another package: known by its entry point, in plant files, scans and commands."""

import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from rs485bus import Plant
from rs485bus.bench.scan import Scan
from rs485bus.errors import BusError
from rs485bus.plant import Family, PlantFile, PlantFileError, families
from rs485bus.plant.families import GROUP
from rs485bus.plant.family import Sign
from rs485bus.sim import SimMks, VirtualLine
from tests.conformance.acme import STATUS, AcmeServo
from tests.conformance.acme_sim import SimAcme
from tests.integration.support import virtual

ACME = Family(
    name="acme",
    title="Acme",
    facade=lambda: AcmeServo,
    baudrates=(9600, 115200),
    signs=(Sign(3, STATUS, count=5),),
    simulate=lambda address, options: SimAcme(address),
)
NOT_A_FAMILY = 3


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[None]:
    """Another package is installed that registers a family."""
    where = getattr(request, "param", "ACME")
    entry = EntryPoint("acme", f"{__name__}:{where}", GROUP)
    module = sys.modules["rs485bus.plant.families"]
    monkeypatch.setattr(module, "entry_points", lambda group: [entry] if group == GROUP else [])
    families.cache_clear()
    yield
    families.cache_clear()


PLANT = '[buses.main]\nport = "COM3"\nbaudrate = 115200\n[axes.a]\nfamily = "acme"\naddress = 4\n'


@pytest.mark.usefixtures("registered")
@virtual
async def test_its_axes_stand_in_plant_files_and_move() -> None:
    async with Plant(PlantFile.loads(PLANT), sim=True) as plant:
        assert isinstance(plant.a, AcmeServo)
        await plant.a.enable()
        assert await plant.a.move_to(1.0) == pytest.approx(1.0, abs=0.01)


@pytest.mark.usefixtures("registered")
def test_its_mistakes_are_told_like_those_of_others() -> None:
    with pytest.raises(PlantFileError, match=r"line 7: axes.a.toleranze: .* Did you mean .tolerance"):
        PlantFile.loads(PLANT + "toleranze = 3\n")
    titles = [
        one.get("title") for one in PlantFile.json_schema()["properties"]["axes"]["additionalProperties"]["anyOf"]
    ]
    assert "Acme" in titles


@pytest.mark.usefixtures("registered")
@virtual
async def test_a_scan_knows_its_drives() -> None:
    devices = (SimAcme(4), SimMks(5))
    scan = Scan(port=lambda line: VirtualLine(*devices, baudrate=line.baudrate), baudrates=[115200], addresses=[4, 5])
    assert [(one.address, one.family) for one in await scan.run()] == [(4, "acme"), (5, "mks")]


@pytest.mark.parametrize("registered", ["NOT_A_FAMILY", "MISSING"], indirect=True)
@pytest.mark.usefixtures("registered")
def test_a_package_that_registers_no_family_is_named() -> None:
    with pytest.raises(BusError, match=r"'acme' of another package \(tests.plant.test_families:"):
        families()


def test_without_its_package_a_family_is_none(tmp_path: Path) -> None:
    with pytest.raises(PlantFileError, match='there is no family "acme"'):
        PlantFile.loads(PLANT)
