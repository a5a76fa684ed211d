"""The bench test of a watchdog finds out what the simulated drive was made to be."""

import pytest

from rs485bus import MksServo, open_bus
from rs485bus.devices.mks.verify import verify_watchdog
from rs485bus.sim import SimMks, VirtualLine
from tests.integration.support import virtual


@pytest.mark.parametrize("feeds", [{"reads"}, {"reads", "writes"}, {"reads", "others"}, {"reads", "broadcasts"}, set()])
@pytest.mark.parametrize("latches", [True, False])
@virtual
async def test_what_feeds_a_drive_is_found_out(feeds: set[str], latches: bool) -> None:
    sim = SimMks(1, fed_by=frozenset({"writes", *feeds}), trip_latches=latches)
    async with open_bus(VirtualLine(sim)) as bus:
        found = await verify_watchdog(MksServo(bus, 1))
    assert found.trips
    assert found.latches is latches
    assert found.reads_feed is ("reads" in feeds)
    assert found.others_feed is ("others" in feeds)
    assert found.broadcasts_feed is ("broadcasts" in feeds)
    assert found.protects is ("reads" in feeds)
    assert sim.watchdog_ms == 0


@virtual
async def test_a_drive_without_a_working_watchdog_is_found_out() -> None:
    class Careless(SimMks):
        """Takes the time and never looks at it."""

        watchdog_ms = 0

    sim = Careless(1)
    async with open_bus(VirtualLine(sim)) as bus:
        found = await verify_watchdog(MksServo(bus, 1))
    assert not found.trips
    assert not found.protects
