"""Before a bus is closed every stop that was asked for is confirmed or reported, and everybody who waits is told."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest

from rs485bus import Bus, BusConfig, MksServo, Urgency, open_bus
from rs485bus.bus.watchdog.guarding import EmergencyReport
from rs485bus.devices.mks import Status
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import write, write_block
from rs485bus.errors import BusClosed, BusError, NotSent, OutcomeUnknown, StopUnconfirmed
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from rs485bus.sim.mks_quirks import Quirks
from rs485bus.wire.frames import crc
from tests.integration.support import Plant, bus_on, plant, virtual


async def left_turning(made: Plant) -> None:
    """Another program has set the motors in motion."""
    for sim in made.sims:
        for request in (
            write(sim.address, r.ENABLE, True),
            write_block(sim.address, r.MOVE_TO_COUNTS, 250, 300, 10**8),
        ):
            sim.receive(request.adu, asyncio.get_running_loop().time())
    await asyncio.sleep(1.0)
    assert not made.stands()


async def emergency(bus: Bus, x: MksServo) -> Any:
    return bus.emergency_stop()


async def stop(bus: Bus, x: MksServo) -> Any:
    return x.stop()


async def hard_stop(bus: Bus, x: MksServo) -> Any:
    return x.emergency_stop()


async def plain_stop(bus: Bus, x: MksServo) -> Any:
    task = asyncio.create_task(bus.unit(1).write_register(r.EMERGENCY_STOP.address, 1, urgency=Urgency.STOP))
    await asyncio.sleep(0)
    return task


STOPS = [emergency, stop, hard_stop, plain_stop]


@pytest.mark.parametrize("how", STOPS)
@pytest.mark.parametrize("by", ["an exception", "its end"])
@pytest.mark.parametrize("settled", [False, True])
@virtual
async def test_a_stop_followed_by_the_end_of_the_block_stops_a_motor_that_another_program_left_turning(
    how: Callable[[Bus, MksServo], Awaitable[Any]], by: str, settled: bool
) -> None:
    made = plant()
    await left_turning(made)
    asked = None
    with suppress(ZeroDivisionError):
        async with bus_on(made) as (bus, (x,)):
            if settled:
                await x.position()
            asked = await how(bus, x)
            if by == "an exception":
                raise ZeroDivisionError
    assert made.stands()
    assert asked is not None
    assert asked.done()
    with suppress(OutcomeUnknown):  # its answer may be an echo, as long as no read was answered
        await asked
    if isinstance(report := getattr(asked, "_result", None), EmergencyReport):
        assert report.all_standing


@pytest.mark.parametrize("how", [emergency, stop, hard_stop])
@virtual
async def test_where_it_cannot_be_seen_to_stand_that_is_reported_before_the_bus_is_closed(
    how: Callable[[Bus, MksServo], Awaitable[Any]],
) -> None:
    made = plant()
    await left_turning(made)
    made.sims[0].receive = lambda frame, now: None  # type: ignore[method-assign]
    with pytest.raises(ZeroDivisionError) as raised:
        async with bus_on(made) as (bus, (x,)):
            asked = await how(bus, x)
            raise ZeroDivisionError
    assert any("could not be seen standing" in note for note in raised.value.__notes__)
    assert [halted.standing for halted in bus.stopped] == [False]
    assert bus.stopped[0].stops >= 3
    if how is emergency:
        assert not (await asked).all_standing
    else:
        with pytest.raises(StopUnconfirmed):
            await asked


@virtual
async def test_motors_that_are_to_be_left_running_are_stopped_all_the_same_where_that_was_asked_for() -> None:
    made = plant(2)
    await left_turning(made)
    async with bus_on(made, BusConfig(leave_running=True)) as (_, (x, _)):
        x.stop()
    now = asyncio.get_running_loop().time()
    assert [sim.moving(now) for sim in made.sims] == [False, True]


@virtual
async def test_one_that_was_said_to_be_unconfirmed_before_is_tried_again_and_reported() -> None:
    made = plant(2)
    await left_turning(made)
    real = made.sims[0]._commands[0xF7]
    for sim in made.sims:
        sim._commands[0xF7] = lambda value, now: None
    with pytest.raises(ZeroDivisionError):
        async with bus_on(made) as (bus, (x, y)):
            for stopped in (x.stop(), y.stop()):
                with pytest.raises(StopUnconfirmed):
                    await stopped
            made.sims[0]._commands[0xF7] = real
            raise ZeroDivisionError
    assert {halted.address: halted.standing for halted in bus.stopped} == {1: True, 2: False}


@virtual
async def test_one_that_is_told_to_stop_once_more_while_the_bus_waits_for_another_stop_is_waited_for() -> None:
    made = plant()
    bus = await open_bus(made.line, config=BusConfig(echo=False, reply_timeout=0.5))
    x = MksServo(bus, 1)
    await x.enable()
    plain = asyncio.create_task(bus.unit(9).write_register(1, 0, urgency=Urgency.STOP))
    await asyncio.sleep(0.001)
    closing = asyncio.create_task(bus.aclose())
    await asyncio.sleep(0.2)
    assert not closing.done()
    again = x.stop()
    await closing
    assert again.done()
    assert again.error is None
    with pytest.raises(OutcomeUnknown):
        await plain


@virtual
async def test_however_often_one_is_told_to_stop_while_the_bus_is_being_closed_each_is_confirmed() -> None:
    made = plant(2)
    await left_turning(made)
    made.sims[1]._commands[0xF7] = lambda value, now: None
    bus = await open_bus(made.line)
    x, y = (MksServo(bus, sim.address) for sim in made.sims)
    await x.position()
    y.stop().add_done_callback(lambda stopped: setattr(stopped, "seen", True))
    closing = asyncio.create_task(bus.aclose())
    stopped = []
    with pytest.raises(BusClosed):
        for _ in range(1000):
            stopped.append(x.stop())
            await asyncio.sleep(0.02)
    await closing
    assert len(stopped) > 10
    assert [handle.error for handle in stopped if handle.done()] == [None] * len(stopped)


WAITERS: dict[str, Callable[[Bus, MksServo], Awaitable[Any]]] = {
    "a broadcast in its turnaround": lambda bus, _: bus.broadcast.write_register(0x92, 1),
    "an emergency stop": lambda bus, _: bus.emergency_stop().wait(),
    "a stop": lambda _, x: x.stop().wait(),
    "a move": lambda _, x: x.move_to(100.0).wait(),
    "a setting": lambda _, x: x.set_zero().wait(),
    "a read of a unit that is not there": lambda bus, _: bus.unit(9).read_holding_registers(0),
    "a read that waits for others": lambda bus, _: bus.unit(1).read_input_registers(0x31, 3, urgency=Urgency.POLL),
    "a write": lambda bus, _: bus.unit(1).write_register(0x84, 16),
    "a plain stop": lambda bus, _: bus.unit(1).write_register(0xF7, 1, urgency=Urgency.STOP),
    "a question": lambda _, x: x.status(),
    "draining": lambda bus, _: bus.drain(),
    "a watchdog's entry": lambda bus, x: bus.watchdog(x, timeout=1.0).__aenter__(),
}


@pytest.mark.parametrize("who", WAITERS)
@pytest.mark.parametrize("after", [0.0, 0.001, 0.004, 0.02])
@pytest.mark.parametrize("unplugged", [False, True])
@virtual
async def test_whoever_waits_when_the_bus_is_closed_is_told_an_end(who: str, after: float, unplugged: bool) -> None:
    made = plant(2)
    bus = await open_bus(made.line, config=BusConfig(turnaround=2.0, echo=False, close_timeout=2.0))
    x, y = (MksServo(bus, sim.address) for sim in made.sims)
    await asyncio.gather(x.enable(), y.enable())
    y.run(300)
    if unplugged:
        made.line.unplug()
        await asyncio.sleep(0.01)

    async def wait() -> None:
        with suppress(BusError):
            await WAITERS[who](bus, x)

    waiting = asyncio.create_task(wait())
    await asyncio.sleep(after)
    await bus.aclose()
    async with asyncio.timeout(0.1):
        await waiting
    if not unplugged:
        assert made.stands()
        assert made.watchdogs_off()


@virtual
async def test_a_write_that_is_on_the_wire_when_the_bus_is_closed_is_told_what_became_of_it() -> None:
    unit = SimUnit(1, {5: 0})
    unit.turnaround = 0.05
    bus = await open_bus(VirtualLine(unit), config=BusConfig(echo=False))
    written = asyncio.create_task(bus.unit(1).write_register(5, 7))
    await asyncio.sleep(0.01)
    await bus.aclose()
    await written
    assert unit.registers[5] == 7


@virtual
async def test_a_broadcast_that_had_left_the_wire_when_the_bus_was_closed_was_sent() -> None:
    unit = SimUnit(1, {5: 0})
    bus = await open_bus(VirtualLine(unit), config=BusConfig(echo=False, turnaround=2.0))
    told = asyncio.create_task(bus.broadcast.write_register(5, 7))
    await asyncio.sleep(0.01)
    await bus.aclose()
    await told
    assert unit.registers[5] == 7


@virtual
async def test_nothing_is_set_in_motion_while_the_bus_is_being_closed() -> None:
    made = plant(2)
    bus = await open_bus(made.line)
    x, y = (MksServo(bus, sim.address) for sim in made.sims)
    await asyncio.gather(x.enable(), y.enable(), x.run(300))
    made.sims[0]._commands[0xF7] = lambda value, now: None  # it takes its time
    closing = asyncio.create_task(bus.aclose())
    await asyncio.sleep(0.01)
    assert bus.closing
    for verb in (lambda: y.run(300), lambda: y.move_to(5.0), y.enable, y.home):
        with pytest.raises(BusClosed, match="being closed"):
            verb()
    with pytest.raises(BusClosed):
        await bus.unit(2).write_registers(0xF6, [0, 300])
    with pytest.raises(BusClosed):
        await bus.broadcast.write_registers(0xF6, [0, 300])
    assert await bus.unit(2).read_input_registers(0x31, 3)  # what moves nothing goes on
    again = y.stop()
    await closing
    assert again.done()
    assert not made.sims[1].moving(asyncio.get_running_loop().time())
    assert made.sims[1].moves == 0


@virtual
async def test_a_stop_while_the_port_is_away_is_said_to_be_unconfirmed_before_long_and_happens_when_it_is_back() -> (
    None
):
    made = plant()
    await left_turning(made)
    async with bus_on(made) as (bus, (x,)):
        await x.position()
        made.line.unplug()
        await asyncio.sleep(0.01)
        begun = bus.now()
        with pytest.raises(StopUnconfirmed, match="the port is gone"):
            await x.stop()
        assert bus.now() - begun < 1.1
        report = bus.emergency_stop()
        async with asyncio.timeout(1.2):
            assert not (await report).all_standing
        assert not made.stands()
        made.line.plug()
        await asyncio.sleep(6.0)
        assert made.stands()


@virtual
async def test_a_stop_that_is_under_way_when_the_port_is_lost_is_confirmed_if_it_is_back_in_time() -> None:
    made = plant()
    async with bus_on(made, BusConfig(reopen_min=0.1)) as (_, (x,)):
        x.enable()
        await x.run(300)
        stopped = x.stop()
        made.line.unplug()
        await asyncio.sleep(0.3)
        made.line.plug()
        await stopped
        assert made.stands()


@virtual
async def test_a_read_whose_time_is_over_while_the_port_of_a_moving_drive_is_away_says_so() -> None:
    made = plant()
    async with bus_on(made) as (bus, (x,)):
        x.enable()
        await x.run(300)
        made.line.unplug()
        await asyncio.sleep(0.01)
        with pytest.raises(NotSent, match="the port is away"):
            await bus.unit(1).read_input_registers(0x31, 3, timeout=0.3)
        made.line.plug()
        await asyncio.sleep(6.0)


@virtual
async def test_what_was_on_the_wire_when_closing_took_too_long_is_unknown_because_the_bus_was_closed() -> None:
    unit = SimUnit(1, {5: 0})
    unit.turnaround = 8.0
    bus = await open_bus(VirtualLine(unit), config=BusConfig(echo=False, reply_timeout=10.0, close_timeout=0.2))
    written = asyncio.create_task(bus.unit(1).write_register(5, 7))
    await asyncio.sleep(0.01)
    await bus.aclose()
    with pytest.raises(OutcomeUnknown, match="the bus is closed"):
        await written


@virtual
async def test_emergency_stops_are_on_the_wire_before_anybody_is_told(caplog: pytest.LogCaptureFixture) -> None:
    made = plant()
    order: list[str] = []
    async with bus_on(made) as (bus, (x,)):
        x.enable()
        await asyncio.sleep(0.5)
        move = x.move_to(50.0)
        await asyncio.sleep(0.5)
        move.add_done_callback(lambda _: order.append("told"))
        transmit = made.line.transmit

        def sending(data: bytes, now: float) -> None:
            order.append("sent")
            transmit(data, now)

        made.line.transmit = sending  # type: ignore[method-assign]
        bus.emergency_stop()
        assert order[:2] == ["sent", "told"]


@pytest.mark.parametrize("deaf_for", [0.8, 2.0, 4.5, 60.0])
@virtual
async def test_a_motor_that_turns_and_does_not_hear_is_stopped_as_long_as_closing_may_take(deaf_for: float) -> None:
    made = plant()
    (sim,) = made.sims
    loop = asyncio.get_running_loop()
    hears = sim.receive
    with pytest.raises(ZeroDivisionError):
        async with bus_on(made) as (bus, (x,)):
            await x.enable()
            await x.run(60)
            until, begun = loop.time() + deaf_for, loop.time()
            sim.receive = lambda frame, now: hears(frame, now) if now > until else None  # type: ignore[method-assign]
            raise ZeroDivisionError
    took = loop.time() - begun
    assert took < (deaf_for + 0.2 if deaf_for < 5 else 5.0)
    assert made.stands() is (deaf_for < 5)
    assert [halted.standing for halted in bus.stopped] == [deaf_for < 5]


@virtual
async def test_on_a_slow_line_a_status_that_lies_does_not_have_a_bus_closed_on_a_motor_that_turns() -> None:
    """A status alone will do only where many are stopped at once, or the pair is never quiet."""
    sim = SimMks(1, quirks=Quirks(lying=Status.STOPPED))
    hears, ramp = sim.receive, bytes.fromhex("011000F6000204006E0000")

    def coasts(frame: bytes, now: float) -> bytes | None:
        """The load takes two seconds to come to rest, however hard it is stopped."""
        if frame[1:4] != bytes((6, 0, r.EMERGENCY_STOP.address)):
            return hears(frame, now)
        hears(ramp + crc(ramp), now)
        return frame

    sim.receive = coasts  # type: ignore[method-assign]
    async with open_bus(VirtualLine(sim, baudrate=9600, turnaround=0.012)) as bus:
        x = MksServo(bus, 1)
        await x.enable()
        await x.run(300)
    assert [halted.standing for halted in bus.stopped] == [True]
    assert not sim.moving(asyncio.get_running_loop().time())
