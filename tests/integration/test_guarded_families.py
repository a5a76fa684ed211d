"""What a watchdog block promises, shown for each family that has a watchdog."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest

from rs485bus import Bus, MksServo, Zlac8015d, open_bus
from rs485bus.devices.axis import Axis
from rs485bus.devices.zlac.values import ControlWord
from rs485bus.errors import MotionError, RearmRequired
from rs485bus.sim import SimMks, SimZlac, VirtualLine
from rs485bus.wire.frames import write_single
from tests.integration.support import virtual

FAMILIES = ["MKS", "ZLAC"]
both_families = pytest.mark.parametrize("family", FAMILIES)


class Crash(Exception):
    """What the application's code raises."""


@dataclass
class Guarded:
    """One drive on a line, and an axis of it."""

    bus: Bus
    sim: SimMks | SimZlac
    facade: MksServo | Zlac8015d
    axis: Axis

    def stands(self) -> bool:
        """Whether the motor really stands."""
        now = asyncio.get_running_loop().time()
        return not self.sim.moving(now) if isinstance(self.sim, SimMks) else not any(self.sim.rpm(now))

    def stop_behind_the_back(self) -> None:
        """Somebody else stops it."""
        register, value = (0xF7, 1) if isinstance(self.sim, SimMks) else (0x200E, ControlWord.EMERGENCY_STOP)
        self.sim.receive(write_single(1, register, value).adu, self.bus.now())

    async def block_for(self, seconds: float) -> None:
        """Have the drive heard, and then nothing run on the event loop for a while."""
        await self.axis.position()
        asyncio.get_running_loop()._jumping.now += seconds  # type: ignore[attr-defined]
        await asyncio.sleep(0.5)


@asynccontextmanager
async def drive(family: str) -> AsyncIterator[Guarded]:
    """An enabled drive."""
    sim: SimMks | SimZlac = SimMks(1) if family == "MKS" else SimZlac(1, watchdog=0)
    async with open_bus(VirtualLine(sim)) as bus:
        facade: MksServo | Zlac8015d = MksServo(bus, 1) if family == "MKS" else Zlac8015d(bus, 1)
        await facade.enable()
        yield Guarded(bus, sim, facade, facade if isinstance(facade, MksServo) else facade.left)


@both_families
@virtual
async def test_a_caller_that_crashes_inside_the_block_leaves_the_axis_stopped_and_the_watchdog_off(
    family: str,
) -> None:
    crash = Crash("a bug")
    async with drive(family) as on:
        with pytest.raises(Crash) as raised:
            async with on.bus.watchdog(on.facade, timeout=0.5):
                await on.axis.run(60)
                await asyncio.sleep(1.0)
                assert not on.stands()
                assert on.sim.watchdog_ms == 500
                raise crash
        assert raised.value is crash
        assert crash.__cause__ is None
        assert on.stands()
        assert on.sim.watchdog_ms == 0
        assert on.sim.trips == []


@both_families
@virtual
async def test_a_lease_that_is_not_renewed_stops_the_axis_and_it_moves_only_after_renew_and_enable(
    family: str,
) -> None:
    async with drive(family) as on, on.bus.watchdog(on.facade, timeout=0.5, lease=1.0) as guard:
        await on.axis.run(60)
        guard.renew()
        for _ in range(4):
            await asyncio.sleep(0.8)
            guard.renew()
        assert not on.stands()
        await asyncio.sleep(2.0)
        assert on.stands()
        assert on.sim.trips == []
        with pytest.raises(RearmRequired, match="lease of 1 s was not renewed"):
            await on.axis.run(60)
        with pytest.raises(RearmRequired, match=r"renew\(\) the lease"):
            await on.axis.enable()
        guard.renew()
        await on.facade.enable()
        await on.axis.move_by(0.1)


@both_families
@virtual
async def test_an_axis_that_stood_when_its_lease_lapsed_needs_renew_and_no_more(family: str) -> None:
    async with drive(family) as on, on.bus.watchdog(on.facade, timeout=0.5, lease=1.0) as guard:
        await on.axis.move_by(0.2)
        with pytest.raises(RearmRequired, match=r"lease of 1 s"):
            async with on.axis.stream() as setpoint:
                for _ in range(100):
                    setpoint(0.0)
                    await asyncio.sleep(0.05)
        await asyncio.sleep(3.0)
        assert on.sim.trips == []
        with pytest.raises(RearmRequired, match=r"renew\(\)"):
            await on.axis.run(60)
        assert on.stands()
        guard.renew()
        async with on.axis.stream() as setpoint:
            setpoint(60.0)
            await asyncio.sleep(0.2)
            assert not on.stands()
        assert on.stands()
        guard.renew()
        await on.axis.move_by(0.1)


@both_families
@virtual
async def test_a_blocked_event_loop_leaves_the_drive_stopped_by_itself_in_its_time_and_nothing_resumes(
    family: str, caplog: pytest.LogCaptureFixture
) -> None:
    loop = asyncio.get_running_loop()
    async with drive(family) as on, on.bus.watchdog(on.facade, timeout=0.5) as guard:
        await on.axis.run(60)
        await asyncio.sleep(1.0)
        blocked_at = loop.time()
        await on.block_for(3.0)
        # The drive stopped itself, half a second after it was heard last, not when the loop came back.
        (tripped_at,) = on.sim.trips
        assert blocked_at + 0.5 <= tripped_at < blocked_at + 0.52
        assert on.stands()
        with pytest.raises(RearmRequired, match=rf"{on.axis.name} .* unheard for 3\.\d+ s"):
            await on.axis.move_to(1.0)
        assert f"{on.axis.name} was unheard for 3" in caplog.text
        await asyncio.sleep(5.0)
        assert on.stands()
        assert len(on.sim.trips) == 1
        guard.renew()
        await on.facade.enable()
        await on.axis.move_by(0.1)


@both_families
@virtual
async def test_what_the_reply_to_a_feed_says_reaches_the_axis_at_once(family: str) -> None:
    async with drive(family) as on, on.bus.watchdog(on.facade, timeout=0.6):
        move = on.axis.move_to(1000.0, rpm=60)
        await asyncio.sleep(2.0)
        on.stop_behind_the_back()
        asked = on.bus.now()
        with pytest.raises(MotionError):
            await move
        # The next feed, a third of 0.6 s later at most, told that it stands; the move was to take a quarter of an hour.
        assert on.bus.now() - asked < 0.5


@both_families
@virtual
async def test_a_device_that_was_nearly_too_late_is_warned_about_once_with_the_numbers(
    family: str, caplog: pytest.LogCaptureFixture
) -> None:
    async with drive(family) as on, on.bus.watchdog(on.facade, timeout=1.0) as guard:
        await asyncio.sleep(1.0)
        caplog.clear()
        with caplog.at_level(logging.WARNING, "rs485bus"):
            for _ in range(2):
                await on.block_for(0.8)
        (warning,) = [record.getMessage() for record in caplog.records if "margin" in record.getMessage()]
        (report,) = guard.report()
        assert 0.75 < report.longest < 1.0
        assert "unit 1 was unheard for 0.8" in warning
        assert "of the 1 s of its watchdog" in warning
        assert on.sim.trips == []


@both_families
@virtual
async def test_a_device_with_a_quarter_of_its_time_left_is_not_warned_about(
    family: str, caplog: pytest.LogCaptureFixture
) -> None:
    async with drive(family) as on, on.bus.watchdog(on.facade, timeout=1.0) as guard:
        await on.block_for(0.7)
        assert 0.25 <= guard.report()[0].margin < 0.35
        assert "margin" not in caplog.text
