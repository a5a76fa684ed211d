"""What is read and written at connect, and again when the drive may have restarted."""

import asyncio
import logging

import pytest

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import Brake, ControlMode, PowerOnShaft, Synchrony
from rs485bus.errors import DeviceRefused, MotionError
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant


@on_virtual_clock
async def test_what_was_found_is_told() -> None:
    sim = WatchedZlac(lines=2500)
    sim.set(r.SPEED_RESOLUTION, 10)
    async with plant(sim, enabled=False) as p:
        setup = await p.base.set_up()
        assert setup.version == 0x0106
        assert setup.counts_per_turn == (10_000, 10_000)
        assert setup.speed_resolution == 10
        assert setup.speed_limit == 1000
        assert setup.watchdog == 1000
        assert setup.remarks == ()


@on_virtual_clock
async def test_turns_are_four_times_the_encoder_lines_of_each_motor() -> None:
    sim = WatchedZlac(lines=2048)
    sim.set(r.ENCODER_LINES.right, 512)
    async with plant(sim, encoder_lines=1024) as p:
        assert "2048 and 512 lines" in (await p.base.set_up()).remarks[0]
        await p.base.move_to(1.5, 1.5)
        assert p.shafts() == (1.5, 1.5)
        assert (await p.base.snapshot()).motion[0].position == 1.5 * 8192


@on_virtual_clock
async def test_a_drive_without_encoder_lines_is_not_used() -> None:
    sim = WatchedZlac()
    sim.set(r.ENCODER_LINES.left, 0)
    async with plant(sim, enabled=False) as p:
        with pytest.raises(MotionError, match="0x2030"):
            await p.base.enable()


@on_virtual_clock
async def test_the_way_of_starting_is_written_at_every_connect_whatever_it_was() -> None:
    for value in Synchrony:
        sim = WatchedZlac()
        sim.set(r.SYNCHRONY, value)
        async with plant(sim, enabled=False) as p:
            await p.base.set_up()
            assert "06200F0000" in p.sim.writes()
            assert sim.value(r.SYNCHRONY) is Synchrony.ASYNCHRONOUS


@on_virtual_clock
async def test_a_speed_resolution_that_was_asked_for_is_written_if_it_is_another_one() -> None:
    async with plant(speed_resolution=10) as p:
        assert p.sim.value(r.SPEED_RESOLUTION) == 10
        assert p.base.speed_resolution == 10
        begun = len(p.sim.asked)
        p.base._drive.setup = None
        await p.base.set_up()
        assert not [write for write in p.sim.writes(begun) if write.startswith("062022")]


@on_virtual_clock
async def test_writes_are_not_left_to_wear_out_the_eeprom(caplog: pytest.LogCaptureFixture) -> None:
    sim = WatchedZlac()
    sim.set(r.SAVE_WRITES, True)
    with caplog.at_level(logging.WARNING, "rs485bus"):
        async with plant(sim) as p:
            assert "EEPROM" in caplog.text
            written = sim.eeprom_writes
            for speed in range(10):
                await p.base.run(speed, speed)
            assert sim.eeprom_writes == written


@on_virtual_clock
async def test_what_is_better_known_is_remarked(caplog: pytest.LogCaptureFixture) -> None:
    sim = WatchedZlac(watchdog=0)
    sim.set(r.POWER_ON_SHAFT, PowerOnShaft.LOCKED)
    sim.set(r.BRAKE.right, Brake.CLOSED)
    sim.set(r.SPEED_LIMIT, 150)
    with caplog.at_level(logging.WARNING, "rs485bus"):
        async with plant(sim, enabled=False) as p:
            remarks = " ".join((await p.base.set_up()).remarks)
            for remark in ("0x2007", "brake of its right wheel", "150 rpm", "watchdog is off"):
                assert remark in remarks
                assert remark in caplog.text


@on_virtual_clock
async def test_it_is_set_up_once_and_again_when_it_was_silent() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        begun = len(p.sim.asked)
        await p.base.left.move_by(1.0)
        await p.base.enable()
        assert not [write for write in p.sim.writes(begun) if write.startswith("06200F")]
        p.sim.dead = True
        with pytest.raises(Exception, match=r"No reply|stopped answering"):
            await p.base.status()
        p.sim.dead = False
        p.sim.set(r.SYNCHRONY, Synchrony.SYNCHRONOUS)
        await asyncio.sleep(1.0)
        await p.base.left.move_by(1.0)
        assert p.sim.value(r.SYNCHRONY) is Synchrony.ASYNCHRONOUS


@on_virtual_clock
async def test_it_is_set_up_again_when_it_was_switched_off_and_on() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        p.sim.power_cycle(p.now)
        await asyncio.sleep(1.5)
        assert p.sim.value(r.MODE) is ControlMode.UNDEFINED
        await p.base.enable()
        assert p.sim.value(r.MODE) is ControlMode.VELOCITY
        await p.base.run(20, 20)
        assert p.rpm() == pytest.approx((20, 20), abs=2)


@on_virtual_clock
async def test_ramps_that_a_restart_changed_are_written_again() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.run(10, 10, acceleration=20)
        await p.base.stop()
        p.sim.power_cycle(p.now)
        await asyncio.sleep(1.5)
        await p.base.enable()
        await p.base.run(10, 10, acceleration=40)
        assert p.sim.value(r.ACCELERATION_TIME.left) == 250


@on_virtual_clock
async def test_a_ramp_whose_answer_was_lost_is_not_taken_for_written() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        p.sim.lose_request("102080", times=1000)
        with pytest.raises(Exception, match=r"No reply|stopped answering"):
            await p.base.run(100, 100, acceleration=50)
        p.sim._lost_requests.clear()
        await asyncio.sleep(2.5)
        await p.base.run(100, 100, acceleration=50)
        assert p.sim.value(r.ACCELERATION_TIME.left) == 2000


@on_virtual_clock
async def test_a_ramp_that_was_refused_is_not_taken_for_written() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        p.sim.refuse("102080")
        with pytest.raises(DeviceRefused):
            await p.base.run(100, 100, acceleration=50)
        await p.base.run(100, 100, acceleration=50)
        assert p.sim.value(r.ACCELERATION_TIME.left) == 2000


@on_virtual_clock
async def test_zero_in_position_mode_is_an_option_for_drives_that_clear_their_counter_only_there() -> None:
    for option in (False, True):
        sim = WatchedZlac()
        sim.clears_in_position_mode_only = True
        async with plant(sim, zero_in_position_mode=option) as p:
            await p.base.run(50, 50)
            await p.base.stop()
            if option:
                await p.base.set_zero()
                await p.base.move_to(0.5, 0.5)
            else:
                with pytest.raises(MotionError, match="was set to zero and reports"):
                    await p.base.left.set_zero()
