"""Watchdogs that another program has left armed, and drives that start anew inside of a block."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import pytest

from rs485bus import BusConfig, MksServo, Zlac8015d, open_bus
from rs485bus.bus.watchdog.foreign import possible_cause
from rs485bus.devices.mks import registers as r
from rs485bus.errors import MotionError, MoveFailed, RearmRequired, WatchdogInfeasible
from rs485bus.sim import VirtualLine
from tests.integration.guarded import SET_HEARTBEAT, FaultyMks, FaultyZlac, mks_bus, zlac_bus
from tests.integration.support import virtual

OFF = BusConfig(foreign_watchdog="off")


def left_armed(milliseconds: int) -> FaultyMks:
    """A drive whose heartbeat a program has set that was killed."""
    sim = FaultyMks(1)
    sim.settings[r.WATCHDOG.address] = milliseconds
    return sim


@virtual
async def test_a_watchdog_that_a_killed_program_left_armed_is_turned_off_on_request() -> None:
    sim = left_armed(400)
    async with open_bus(VirtualLine(sim), config=OFF) as bus:
        x = MksServo(bus, 1)
        await x.run(60)
        await asyncio.sleep(5.0)
        assert sim.moving(bus.now())
        assert (sim.watchdog_ms, sim.trips) == (0, [])
        assert possible_cause(bus.owner, x.attached) == ""


@virtual
async def test_without_request_it_is_left_alone_and_named_as_a_possible_cause() -> None:
    sim = left_armed(150)
    async with open_bus(VirtualLine(sim)) as bus:
        x = MksServo(bus, 1)
        await x.run(60)
        await asyncio.sleep(0.6)
        assert not sim.moving(bus.now())
        assert sim.watchdog_ms == 150
        await bus.unit(1).read_input_registers(r.STATUS.address, 1)
        cause = possible_cause(bus.owner, x.attached)
        assert "Its own watchdog may have stopped it: it was not asked for 0." in cause
        assert 'BusConfig(foreign_watchdog="off") turns it off' in cause
        with pytest.raises(MoveFailed, match="Its own watchdog may have stopped it"):
            await x.run(60)  # nobody waited for the end of the first one


@virtual
async def test_one_that_this_program_set_is_named_as_such() -> None:
    async with mks_bus() as (bus, _, (x,)):
        await x.set_heartbeat(0.4)
        await x.run(60)
        await asyncio.sleep(0.6)
        await bus.unit(1).read_input_registers(r.STATUS.address, 1)
        assert "which this program has set" in possible_cause(bus.owner, x.attached)
        await x.set_heartbeat(0)
        assert possible_cause(bus.owner, x.attached) == ""


@virtual
async def test_a_drive_without_a_watchdog_or_with_a_fed_one_is_stopped_by_none() -> None:
    async with mks_bus() as (bus, _, (x,)), x.watchdog(0.5):
        await x.run(60)
        await asyncio.sleep(1.0)
        assert possible_cause(bus.owner, x.attached) == ""


@virtual
async def test_a_watchdog_that_could_not_be_turned_off_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    sim = left_armed(400)
    sim.deaf_to = lambda frame: frame[1:4] == SET_HEARTBEAT
    async with open_bus(VirtualLine(sim), config=OFF) as bus:
        MksServo(bus, 1)
        await asyncio.sleep(5.0)
    assert "MKS 1: its watchdog could not be turned off: no answer" in caplog.text


@virtual
async def test_a_zlac_that_is_on_is_turned_off_on_request_and_a_block_restores_that() -> None:
    sim = FaultyZlac(1, watchdog=1000)
    async with open_bus(VirtualLine(sim), config=OFF) as bus:
        base = Zlac8015d(bus, 1)
        setup = await base.set_up()
        assert setup.watchdog == 0
        async with base.watchdog(0.5):
            assert sim.watchdog_ms == 500
        assert sim.watchdog_ms == 0


@virtual
async def test_a_zlac_with_another_time_than_it_is_shipped_with_is_warned_of_and_fed(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING, "rs485bus"):
        async with zlac_bus(watchdog=600) as (_, sim, base):
            await base.enable()
            await asyncio.sleep(5.0)
            assert sim.trips == []
    assert "its watchdog is set to 600 ms (0x2000), perhaps by another program that was killed" in caplog.text


@virtual
async def test_a_zlac_with_a_time_that_cannot_be_fed_says_who_may_have_left_it_and_what_turns_it_off() -> None:
    with pytest.raises(WatchdogInfeasible) as refused:
        async with zlac_bus(watchdog=100):
            pass
    assert 'BusConfig(foreign_watchdog="off") turns it off' in refused.value.__notes__[0]


def test_another_policy_is_refused() -> None:
    with pytest.raises(ValueError, match="foreign_watchdog 'on' is neither 'keep' nor 'off'"):
        BusConfig(foreign_watchdog="on")  # type: ignore[arg-type]


# Restarts


@virtual
async def test_a_drive_that_starts_anew_inside_of_a_block_moves_only_after_enable_and_is_armed_again() -> None:
    async with mks_bus() as (bus, (sim,), (x,)), x.watchdog(3.0) as guard:
        await x.enable()
        await x.move_to(3.0)
        sim.settings[r.WATCHDOG.address] = 0
        sim.restart(bus.now())
        await asyncio.sleep(2.0)
        with pytest.raises(MotionError, match="restarted"):
            await x.move_to(1.0)
        assert guard.report()[0].trips == 1
        with pytest.raises(RearmRequired, match="started anew"):
            await x.run(60)
        await x.enable()
        assert sim.watchdog_ms == 3000
        await x.set_zero()
        await x.move_to(1.0)
        await asyncio.sleep(3.0)
        assert sim.trips == []


@virtual
async def test_a_zlac_that_starts_anew_inside_of_a_block_is_armed_again_by_enable() -> None:
    async with zlac_bus(watchdog=0) as (bus, sim, base):
        async with base.watchdog(0.6):
            await base.enable()
            await base.move_to(1.0, 1.0)
            sim.eeprom[0x2000] = 0
            sim.power_cycle(bus.now())
            await asyncio.sleep(2.5)
            failure: Any = None
            for _ in range(2):
                try:
                    await base.move_to(2.0, 2.0)
                except MotionError as error:
                    failure = error
            assert failure is not None
            await base.enable()
            assert sim.watchdog_ms == 600
        assert sim.watchdog_ms == 0
