"""Who takes one face for the other, or forgets to enter a block, is told what to do."""

import gc

import pytest

from rs485bus import AxisGroup, DifferentialDrive, MksServo, Plant, Zlac8015d, blocking, open_bus
from rs485bus.errors import LimitExceeded
from rs485bus.plant import PlantFile
from rs485bus.sim import SimMks, SimZlac, VirtualLine
from tests.integration.support import virtual
from tests.plant.support import CELL


def line() -> VirtualLine:
    return VirtualLine(SimMks(1), SimZlac(3))


@virtual
async def test_a_block_that_is_entered_by_with_says_that_it_is_async_with() -> None:
    with pytest.raises(TypeError, match="by `async with`; without async, that of"), open_bus(line()):  # type: ignore[attr-defined]
        pass
    async with open_bus(line()) as bus:
        x, base = MksServo(bus, 1), Zlac8015d(bus, 3)
        await x.enable()
        guard = bus.watchdog(x, timeout=1.0)
        blocks = [guard, x.stream(), base.stream(), AxisGroup(x=x).stream(), DifferentialDrive(base, 1, 1).stream()]
        for block in (*blocks, x.move_to(1), Plant(PlantFile.loads(CELL), sim=True)):
            with pytest.raises(TypeError, match="by `async with`"), block:  # type: ignore[attr-defined]
                pass
        async with guard:
            pass


def test_an_object_of_the_blocking_face_in_an_asynchronous_class_is_told_by_its_face() -> None:
    with blocking.open_bus(line()) as bus:
        x, base = bus.mks(1), bus.zlac(3)
        for wrong in (
            lambda: MksServo(bus, 1),
            lambda: AxisGroup(x=x),
            lambda: DifferentialDrive(base, 0.085, 0.4),
        ):
            with pytest.raises(TypeError, match=r"That is of rs485bus.blocking: make what takes it there, too"):
                wrong()


def test_a_vehicle_is_of_a_drive_and_not_of_one_of_its_wheels() -> None:
    with blocking.open_bus(line()) as bus:
        with pytest.raises(TypeError, match=r"zlac must be made like .*both wheels, not <ZLAC 3 left>$"):
            bus.vehicle(bus.zlac(3).left, 0.085, 0.4)
        vehicle = bus.vehicle(bus.zlac(3), 0.085, 0.4)
        assert repr(vehicle) == "<vehicle on ZLAC 3>"
        vehicle.enable().wait()
        vehicle.drive(0.1, 0.0).wait()
        vehicle.stop().wait()


def test_a_watchdog_block_that_is_never_entered_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    with blocking.open_bus(line()) as bus:
        guard = bus.watchdog(bus.mks(1), timeout=1.0)
        assert repr(guard) == "<watchdog block of MKS 1, not entered: it guards nothing>"
        with guard:
            assert repr(guard) == "<watchdog block of MKS 1, entered>"
        del guard
        gc.collect()
        assert "not entered" not in caplog.text
        bus.watchdog(bus.mks(1), timeout=1.0)
        assert "<watchdog block of MKS 1, not entered: it guards nothing>. Enter it by `async with`" in caplog.text


def test_an_axis_of_a_plant_that_is_not_open_is_told_for_both_faces() -> None:
    for plant in (Plant(PlantFile.loads(CELL)), blocking.Plant(PlantFile.loads(CELL))):
        with pytest.raises(AttributeError, match=r"while the plant is open: in its block, .*blocking `with plant`"):
            plant.x  # noqa: B018


def test_completion_offers_the_public_names_alone() -> None:
    import rs485bus

    assert {"MksServo", "AxisGroup", "Plant", "open_bus", "Bus"} <= set(dir(blocking))
    assert not {"block", "mirror", "Any", "face_class"} & set(dir(blocking))
    assert {"MksServo", "blocking", "errors"} <= set(dir(rs485bus))
    assert not {"Any", "import_module", "TYPE_CHECKING"} & set(dir(rs485bus))


@virtual
async def test_lengths_in_millimetres_and_axes_without_names_are_told_how_they_are_given() -> None:
    async with open_bus(line()) as bus:
        base, x = Zlac8015d(bus, 3), MksServo(bus, 1)
        with pytest.raises(LimitExceeded, match=r"in metres, up to 5, not 85: 85 mm are 0.085 m"):
            DifferentialDrive(base, 85, 0.4)
        with pytest.raises(LimitExceeded, match=r"track is in metres"):
            DifferentialDrive(base, 0.085, 400)
        with pytest.raises(TypeError, match=r"bus.group\(x=x, y=y\)"):
            AxisGroup(x)  # type: ignore[arg-type]
