"""A watchdog block from entering to leaving: each entry stands alone, and says what is so."""

from __future__ import annotations

import asyncio
import logging
import threading

import pytest

from rs485bus import MksServo, open_bus
from rs485bus.bus.schedule.job import Urgency
from rs485bus.errors import (
    BusError,
    DeviceRefused,
    NotGuarding,
    NotSent,
    NotSupported,
    RequestFailed,
    WatchdogInUse,
    WrongThread,
)
from rs485bus.sim import VirtualLine
from tests.integration.guarded import SET_HEARTBEAT, FaultyMks, line_of, mks_bus, within, zlac_bus
from tests.integration.support import virtual


class Boom(Exception):
    """What a body raises."""


# Leases


@virtual
async def test_a_block_that_is_entered_a_second_time_enforces_its_lease() -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        guard = bus.watchdog(x, timeout=0.5, lease=1.0)
        async with guard:
            await asyncio.sleep(0.5)
        await asyncio.sleep(2.0)
        async with guard:
            await x.run(60)
            await asyncio.sleep(1.5)
            assert not sim.moving(bus.now())
            assert sim.trips == []


@virtual
async def test_a_lease_that_lapses_in_the_first_entry_leaves_the_second_its_own() -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        guard = bus.watchdog(x, timeout=0.5, lease=1.0)
        async with guard:
            await asyncio.sleep(1.5)
        async with guard:
            await x.enable()
            await x.run(60)
            await asyncio.sleep(0.7)
            guard.renew()
            await asyncio.sleep(0.7)
            assert sim.moving(bus.now())


@virtual
async def test_renew_outside_of_the_block_is_an_error_and_stops_nothing_later() -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        guard = bus.watchdog(x, timeout=0.5, lease=0.5)
        with pytest.raises(NotGuarding, match=r"Enter it first"):
            guard.renew()
        async with guard:
            guard.renew()
        with pytest.raises(BusError):
            guard.renew()
        await x.run(60)
        await asyncio.sleep(3.0)
        assert sim.moving(bus.now())


@virtual
async def test_renew_from_a_foreign_thread_is_refused() -> None:
    async with mks_bus() as (bus, _, (x,)), bus.watchdog(x, timeout=0.5, lease=5.0) as guard:
        raised: list[BaseException] = []

        def call() -> None:
            try:
                guard.renew()
            except BaseException as error:
                raised.append(error)

        thread = threading.Thread(target=call)
        thread.start()
        thread.join()
        assert isinstance(raised[0], WrongThread)


@virtual
async def test_a_block_that_is_entered_inside_of_itself_is_in_use() -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        guard = bus.watchdog(x, timeout=0.5)
        async with guard:
            with pytest.raises(WatchdogInUse):
                await guard.__aenter__()
            assert sim.watchdog_ms == 500
            await asyncio.sleep(2.0)
            assert guard.report()[0].trips == 0
        assert sim.watchdog_ms == 0


# Former values


@virtual
async def test_a_zlac_gets_back_what_was_written_since_the_first_block() -> None:
    async with zlac_bus(watchdog=1000) as (bus, sim, base):
        async with base.watchdog(0.5):
            pass
        assert sim.watchdog_ms == 1000
        await bus.unit(1).write_register(0x2000, 3000)
        async with base.watchdog(0.5):
            assert sim.watchdog_ms == 500
        assert sim.watchdog_ms == 3000
        assert sim.trips == []


@pytest.mark.parametrize("milliseconds", [250, 400, 700, 3000])
@virtual
async def test_a_zlac_whose_time_is_written_outside_of_a_block_is_fed_by_it(milliseconds: int) -> None:
    async with zlac_bus(watchdog=1000) as (bus, sim, base):
        await base.enable()
        await bus.unit(1).write_register(0x2000, milliseconds)
        await asyncio.sleep(10.0)
        assert sim.trips == []
        assert sim.longest_unheard < 0.5 * milliseconds / 1000


@virtual
async def test_a_zlac_that_is_switched_on_outside_of_a_block_is_fed_and_switched_off_is_not() -> None:
    async with zlac_bus(watchdog=0) as (bus, sim, base):
        await base.enable()
        await bus.unit(1).write_registers(0x2000, [600])
        await asyncio.sleep(5.0)
        assert sim.trips == []
        await bus.unit(1).write_register(0x2000, 0)
        asked = bus.stats.transactions
        await asyncio.sleep(5.0)
        assert bus.stats.transactions == asked


@virtual
async def test_a_watchdog_that_is_turned_off_inside_of_its_block_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    async with zlac_bus(watchdog=1000) as (bus, _, base), base.watchdog(0.5):
        await bus.unit(1).write_register(0x2000, 300)
        assert "turned off" not in caplog.text
        await bus.unit(1).write_register(0x2000, 0)
        assert "the watchdog of unit 1 was turned off by a write, inside of its watchdog block" in caplog.text


@virtual
async def test_a_shorter_time_holds_though_the_write_was_not_answered() -> None:
    async with zlac_bus(watchdog=1000) as (bus, sim, base):
        await base.enable()
        answer = sim.answer

        def lose(pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
            reply = answer(pdu, now, broadcast=broadcast)
            return None if pdu[:3] == bytes((6, 0x20, 0)) else reply

        sim.answer = lose  # type: ignore[method-assign]
        with pytest.raises(RequestFailed):
            await bus.unit(1).write_register(0x2000, 300)
        await asyncio.sleep(5.0)
        assert sim.watchdog_ms == 300
        assert sim.trips == []


@virtual
async def test_an_mks_gets_back_the_heartbeat_that_this_program_had_set() -> None:
    async with mks_bus() as (_, (sim,), (x,)):
        await x.set_heartbeat(5.0)
        async with x.watchdog(0.5):
            assert sim.watchdog_ms == 500
        assert sim.watchdog_ms == 5000
        await x.set_heartbeat(0)


# What is told


@pytest.mark.parametrize("raised", [Boom, asyncio.CancelledError, KeyError])
@virtual
async def test_what_was_not_seen_standing_is_told_with_the_exception_that_left_the_block(
    raised: type[BaseException], caplog: pytest.LogCaptureFixture
) -> None:
    error = raised()
    bus_errors: list[BaseException] = []
    try:
        async with mks_bus() as (bus, (sim,), (x,)):
            with pytest.raises(raised) as left:
                async with bus.watchdog(x, timeout=2.0):
                    await x.run(60)
                    sim.dead = True
                    raise error
            assert left.value is error
            assert any("MKS 1 could not be seen standing" in note for note in error.__notes__)
            assert "MKS 1 could not be seen standing" in caplog.text
            await asyncio.sleep(3.0)
            sim.dead = False
            await asyncio.sleep(3.0)
            assert not sim.moving(bus.now())
    except ExceptionGroup as group:
        bus_errors += group.exceptions
    # Whoever cancels swallows the notes: so it is raised when the bus is closed, too.
    assert bool(bus_errors) == (raised is asyncio.CancelledError)


@virtual
async def test_a_drive_that_stands_only_later_has_its_watchdog_restored_then() -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        with pytest.raises(Boom):
            async with bus.watchdog(x, timeout=2.0):
                await x.run(60)
                sim.dead = True
                raise Boom
        assert sim.watchdog_ms == 2000
        await asyncio.sleep(1.0)
        sim.dead = False
        await asyncio.sleep(4.0)
        assert not sim.moving(bus.now())
        assert sim.watchdog_ms == 0
        await x.enable()
        await x.run(60)
        await asyncio.sleep(4.0)
        assert sim.moving(bus.now())


@virtual
async def test_a_report_keeps_a_trip() -> None:
    async with mks_bus() as (bus, (sim,), (x,)), bus.watchdog(x, timeout=0.6) as guard:
        await x.run(60)
        await asyncio.sleep(1.0)
        sim.dead = True
        await asyncio.sleep(1.0)
        sim.dead = False
        await asyncio.sleep(1.0)
        await x.enable()
        await asyncio.sleep(1.0)
        (report,) = guard.report()
        assert report.trips == 1
        assert report.longest >= sim.longest_unheard - 0.001 > 0.6
        assert report.margin < 0


@virtual
async def test_a_report_ends_for_each_device_when_its_watchdog_is_turned_off() -> None:
    """Another one takes its time to stop meanwhile."""
    async with mks_bus(2) as (bus, sims, (x, y)):
        async with bus.watchdog(x, y, timeout=1.0) as guard:
            await asyncio.gather(x.enable(), y.enable())
            await y.run(100, acceleration=79)
        assert not any(sim.trips for sim in sims)
        assert all(report.longest < 0.5 and not report.trips for report in guard.report())


@virtual
async def test_each_entry_has_a_report_of_its_own_that_can_be_read_after_it() -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        guard = bus.watchdog(x, timeout=0.6)
        assert guard.report() == []
        async with guard:
            await asyncio.sleep(1.0)
            sim.dead = True
            await asyncio.sleep(1.0)
            sim.dead = False
            await x.enable()
        (first,) = guard.report()
        assert (first.trips, first.feeds > 0) == (1, True)
        async with guard:
            await asyncio.sleep(1.0)
            (second,) = guard.report()
            assert (second.trips, second.longest < 0.3) == (0, True)
        assert guard.report()[0].trips == 0


@virtual
async def test_after_a_refused_arming_nothing_is_said_of_a_heartbeat_that_was_never_set(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        receive = sim.receive

        def refuse(frame: bytes, now: float) -> bytes | None:
            if frame[1:4] != SET_HEARTBEAT:
                return receive(frame, now)
            from rs485bus.wire.frames import crc

            body = frame[:4] + b"\0\0"
            return body + crc(body)

        sim.receive = refuse  # type: ignore[method-assign]
        with caplog.at_level(logging.WARNING, "rs485bus"), pytest.raises(NotSupported, match="its firmware") as refused:
            async with bus.watchdog(x, timeout=0.6):
                pass
        assert isinstance(refused.value, DeviceRefused)
        assert "could not be set back" not in caplog.text
        assert bus.owner.feeding.all() == []
        await x.enable()
        await asyncio.sleep(2.0)
        assert sim.watchdog_ms == 0


@virtual
async def test_after_a_failed_entry_enable_arms_nothing() -> None:
    async with mks_bus(2) as (bus, (sim, other), (x, y)):
        other.deaf_to = lambda frame: frame[1:4] == SET_HEARTBEAT
        with pytest.raises(RequestFailed):
            async with bus.watchdog(x, y, timeout=0.6):
                pass
        other.deaf_to = lambda frame: False
        for axis in (x, y):
            await axis.emergency_stop()
            await axis.enable()
        await asyncio.sleep(2.0)
        assert [sim.watchdog_ms, other.watchdog_ms] == [0, 0]
        assert bus.owner.feeding.all() == []
        await y.run(60)
        await asyncio.sleep(2.0)
        assert other.moving(bus.now())


# The port


@virtual
async def test_entering_while_the_port_is_away_is_refused_at_once() -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        await x.position()
        line_of(bus).unplug()
        await asyncio.sleep(0.01)
        begun = bus.now()
        with pytest.raises(NotSent, match="Nothing was armed: the port is gone"):
            async with x.watchdog(0.5):
                pass
        assert bus.now() - begun < 0.01
        line_of(bus).plug()
        await asyncio.sleep(3.0)
        async with x.watchdog(0.5):
            await asyncio.sleep(1.0)
        assert sim.trips == []


@pytest.mark.parametrize("after", [0.0005, 0.004, 0.009, 0.02])
@virtual
async def test_a_port_that_is_lost_while_a_block_is_entered_ends_that(after: float) -> None:
    async with mks_bus(4) as (bus, sims, axes):
        await axes[0].position()
        asyncio.get_running_loop().call_later(after, line_of(bus).unplug)
        begun = bus.now()
        with pytest.raises(BusError):
            async with bus.watchdog(*axes, timeout=1.0):
                await asyncio.sleep(1.0)
        assert bus.now() - begun < 6.0
        line_of(bus).plug()
        await asyncio.sleep(6.0)
        for axis in axes:
            await within(1.0, axis.enable().wait())
            await within(1.0, axis.run(60).wait())
        await asyncio.sleep(2.0)
        assert [sim.watchdog_ms for sim in sims] == [0] * 4
        assert all(sim.moving(bus.now()) for sim in sims)


@virtual
async def test_a_block_that_is_left_while_the_port_is_away_ends_and_tells() -> None:
    async with mks_bus() as (bus, (sim,), (x,)):
        begun = 0.0
        with pytest.raises(BusError, match="could not be seen standing"):
            async with x.watchdog(0.5):
                await x.run(60)
                move = x.move_to(5.0)
                line_of(bus).unplug()
                await asyncio.sleep(0.2)
                begun = bus.now()
        with pytest.raises(BusError):
            await move
        assert bus.now() - begun < 6.0
        assert not sim.moving(bus.now())  # its watchdog has stopped it
        line_of(bus).plug()
        await asyncio.sleep(6.0)
        assert sim.watchdog_ms == 0


# On an idle bus


@virtual
async def test_a_block_that_is_entered_asks_each_drive_once_and_sets_it_once() -> None:
    sims = [FaultyMks(address) for address in (1, 2)]
    async with open_bus(VirtualLine(*sims)) as bus:
        axes = [MksServo(bus, sim.address) for sim in sims]
        async with bus.watchdog(*axes, timeout=1.0):
            sent = [(record.address, record.request[1], record.urgency) for record in bus.flight]
        assert sent == [(1, 4, Urgency.FEED), (2, 4, Urgency.FEED), (1, 16, Urgency.FEED), (2, 16, Urgency.FEED)]
