"""The watchdog of both wheels, the unplugged adapter, and what happens after either."""

import asyncio
import logging

import pytest

from rs485bus import Zlac8015d, open_bus
from rs485bus.devices.zlac.values import ControlWord
from rs485bus.errors import LimitExceeded, MotionError, NotEnabled, NotSent, RearmRequired, WatchdogInfeasible
from rs485bus.sim import VirtualLine
from rs485bus.wire.frames import write_single
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant, word
from tests.devices.zlac.test_stopping import WAYS, all_failed, check_targets_are_zeroed_before, under_way

EMERGENCY_STOP = word(ControlWord.EMERGENCY_STOP)


@pytest.mark.parametrize("guard", ["base", "wheel"])
@on_virtual_clock
async def test_a_block_guards_both_wheels_and_restores_what_the_watchdog_was(guard: str) -> None:
    async with plant(WatchedZlac(watchdog=2000)) as p:
        async with p.bus.watchdog(p.base if guard == "base" else p.base.left, timeout=0.5) as watchdog:
            assert p.sim.watchdog_ms == 500
            await p.base.run(50, 50)
            await asyncio.sleep(5.0)
            assert p.sim.trips == []
            assert watchdog.report()[0].margin > 0.5
        assert p.rpm() == (0, 0)
        assert p.sim.watchdog_ms == 2000
        # It is on still, and goes on being fed.
        await asyncio.sleep(10.0)
        assert p.sim.trips == []
        await p.base.left.move_to(5.0)


@on_virtual_clock
async def test_leaving_a_block_waits_for_what_is_queued_on_either_wheel() -> None:
    async with plant() as p:
        async with p.base.left.watchdog(0.5):
            p.base.right.move_to(3.0)
        assert p.shafts() == (0.0, 3.0)


@on_virtual_clock
async def test_a_watchdog_that_is_off_is_off_again_after_the_block_and_was_warned_about(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING, "rs485bus"):
        async with plant(WatchedZlac(watchdog=0)) as p:
            assert "watchdog is off" in caplog.text
            async with p.base.watchdog(0.5):
                assert p.sim.watchdog_ms == 500
            assert p.sim.watchdog_ms == 0


@on_virtual_clock
async def test_a_watchdog_that_is_on_as_shipped_is_fed_without_being_asked() -> None:
    async with plant(WatchedZlac(watchdog=1000)) as p:
        await asyncio.sleep(10.0)
        await p.base.left.move_to(10.0)
        assert p.sim.trips == []
        assert p.sim.value_writes("062000") == 0  # it was so already: its EEPROM is spared


@on_virtual_clock
async def test_a_watchdog_that_does_not_take_its_time_is_not_armed() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        p.sim.ignored = "062000"
        with pytest.raises(Exception, match="Refused"):
            async with p.base.watchdog(0.5):
                pass


@on_virtual_clock
async def test_what_the_register_cannot_hold_or_the_line_cannot_feed_is_refused() -> None:
    async with plant() as p:
        for timeout in (33.0, 0.0):
            with pytest.raises(LimitExceeded):
                async with p.base.watchdog(timeout):
                    pass
        with pytest.raises(WatchdogInfeasible):
            async with p.base.watchdog(0.02):
                pass
        assert p.sim.watchdog_ms == 1000


@pytest.mark.parametrize("how", WAYS)
@on_virtual_clock
async def test_after_a_trip_the_wheels_move_only_after_enable_and_by_no_old_target(how: str) -> None:
    async with plant() as p, p.base.watchdog(0.5):
        moves = await under_way(p, how)
        p.sim.dead = True
        await asyncio.sleep(0.7)
        assert p.rpm() == (0, 0)
        assert p.sim.trips
        p.sim.dead = False
        await asyncio.sleep(1.0)
        await all_failed(moves)
        assert await p.standing_for(1.0)
        with pytest.raises(RearmRequired):
            await p.base.left.run(10)
        begun = len(p.sim.asked)
        await p.base.enable()
        writes = p.sim.writes(begun)
        assert writes[0] == EMERGENCY_STOP
        check_targets_are_zeroed_before(writes)
        assert await p.standing_for(3.0)
        assert p.sim.watchdog_ms == 500
        there = p.shafts()
        await p.base.move_by(1.0, 1.0)
        assert p.shafts() == pytest.approx((there[0] + 1, there[1] + 1), abs=0.005)


@pytest.mark.parametrize("how", WAYS)
@pytest.mark.parametrize("watchdog", [0, 1000])
@on_virtual_clock
async def test_after_an_unplugging_the_wheels_move_only_after_enable_and_by_no_old_target(
    how: str, watchdog: int
) -> None:
    async with plant(WatchedZlac(watchdog=watchdog)) as p:
        moves = await under_way(p, how)
        begun = len(p.sim.asked)
        p.line.unplug()
        await asyncio.sleep(0.3)
        p.line.plug()
        await asyncio.sleep(3.0)
        await all_failed(moves)
        assert p.sim.writes(begun)[0] == EMERGENCY_STOP
        assert await p.standing_for(1.0)
        refused: tuple[type[MotionError], ...] = (NotEnabled, RearmRequired)
        with pytest.raises(refused):
            await p.base.left.run(10)
        begun = len(p.sim.asked)
        await p.base.enable()
        check_targets_are_zeroed_before(p.sim.writes(begun))
        assert await p.standing_for(3.0)
        await p.base.run(20, 20)


@on_virtual_clock
async def test_a_move_under_way_when_the_port_is_lost_says_so() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        move = p.base.move_to(10.0, 10.0)
        await asyncio.sleep(1.0)
        p.line.unplug()
        with pytest.raises(NotSent, match="port was lost"):
            await move
        p.line.plug()


@on_virtual_clock
async def test_a_drive_switched_off_while_unplugged_is_set_up_again_and_its_positions_are_not_trusted() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.move_to(2.0, 2.0)
        p.line.unplug()
        p.sim.power_cycle(p.now)
        await asyncio.sleep(2.0)
        p.line.plug()
        await asyncio.sleep(6.0)
        await p.base.enable()
        with pytest.raises(MotionError, match="restarted"):
            await p.base.left.move_to(0.0)


@on_virtual_clock
async def test_a_lease_that_is_not_renewed_stops_both_wheels() -> None:
    async with plant() as p, p.base.watchdog(0.5, lease=1.0):
        await p.base.run(50, 50)
        await asyncio.sleep(3.0)
        assert await p.standing_for(1.0)


@on_virtual_clock
async def test_broadcasts_that_touch_its_registers_are_taken_for_heard_and_others_not() -> None:
    async with plant(enabled=False) as p:
        hears = p.base.attached.hears
        assert hears(write_single(0, 0x200E, 5))
        assert hears(write_single(0, 0x20B0, 0))
        assert not hears(write_single(0, 0x00F7, 1))  # the emergency stop of another family
        assert p.base.attached.broadcast_stop() is None


@on_virtual_clock
async def test_several_drives_are_guarded_together() -> None:
    sims = [WatchedZlac(address) for address in (1, 2, 3)]
    async with open_bus(VirtualLine(*sims)) as bus:
        bases = [Zlac8015d(bus, sim.address) for sim in sims]
        async with bus.watchdog(*bases, timeout=0.6):
            await asyncio.gather(*(base.enable().wait() for base in bases))
            for base in bases:
                base.run(50, 50)
            await asyncio.sleep(3.0)
            assert [sim.trips for sim in sims] == [[], [], []]
    assert all(halted.standing for halted in bus.stopped)


@on_virtual_clock
async def test_one_that_restarts_in_a_block_gets_the_time_of_the_block_again_not_its_own() -> None:
    async with plant(WatchedZlac(watchdog=1000)) as p, p.base.watchdog(0.6):
        await p.base.left.run(60)
        p.sim.restart_takes = 0.05
        p.sim.eeprom.clear()  # it keeps nothing that was written
        p.sim.power_cycle(p.now)
        await asyncio.sleep(0.5)
        assert p.sim.watchdog_ms == 1000
        with pytest.raises(MotionError):
            await p.base.left.move_to(0.5)
        await p.base.enable()
        assert p.sim.watchdog_ms == 600
