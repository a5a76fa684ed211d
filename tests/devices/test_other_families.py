"""A facade made for another family than the drive at its address says so, where the drive's answer tells."""

from collections.abc import Callable
from typing import Any

import pytest

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.errors import DeviceRefused
from rs485bus.sim import SimMks, SimTlr, SimUnit, SimZlac, VirtualLine
from tests.integration.support import virtual

ANSWERED: list[tuple[Callable[..., Any], str, Callable[..., Any]]] = [
    (MksServo, "MKS", SimZlac),
    (MksServo, "MKS", SimTlr),
    (Zlac8015d, "ZLAC", SimTlr),
    (TlrStepper, "TL-R", SimZlac),
]
"""An MKS drive answers nothing to function 03, and so tells no more than one that is not there."""


@pytest.mark.parametrize(("facade", "family", "sim"), ANSWERED)
@virtual
async def test_a_drive_that_knows_no_such_request_may_be_another_one(
    facade: Callable[..., Any], family: str, sim: Callable[..., Any]
) -> None:
    async with open_bus(VirtualLine(sim(1))) as bus:
        drive = facade(bus, 1)
        axis = getattr(drive, "left", drive)
        for ask in (drive.enable, lambda: axis.move_to(1.0), axis.position):
            with pytest.raises(
                DeviceRefused, match=f"may be another drive than the {family} that the facade"
            ) as refused:
                await ask()
            assert "screen" not in str(refused.value)


@virtual
async def test_what_a_unit_without_a_facade_does_not_know_is_its_own_matter() -> None:
    async with open_bus(VirtualLine(SimUnit(7, {0: 0}), SimMks(1))) as bus:
        with pytest.raises(DeviceRefused) as refused:
            await bus.unit(7).read_holding_registers(5)
        assert "another drive" not in str(refused.value)
