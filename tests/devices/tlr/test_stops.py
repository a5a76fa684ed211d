"""A stop stops, whatever the control word was before; and nobody is told of a watchdog that there is not."""

import asyncio

import pytest

from rs485bus import BusConfig, MksServo, TlrStepper, open_bus
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.tlr import DiFunction
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.drive import TlrDrive
from rs485bus.devices.tlr.frames import read
from rs485bus.errors import BroadcastConflict, MoveCancelled, MoveFailed, NotSupported
from rs485bus.sim import SimMks, SimTlr, TlrMachine, VirtualLine
from rs485bus.wire.frames import crc, read_holding, write_multiple, write_single
from tests.devices.tlr.support import TRIGGERS, lose, now, stepper_on, writes
from tests.integration.support import virtual

CONTROL = r.CONTROL.address


@TRIGGERS
@virtual
async def test_a_jog_ends_by_a_stop(trigger: str) -> None:
    sim = SimTlr(trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        x.enable()
        await x.run(-300, acceleration=1000)
        assert await x.velocity() == -300
        assert writes(sim, r.JOG.address) == [(0x10000 - 300, 300, 300)]
        assert writes(sim, CONTROL)[-2:] == [(0,), (8,)]
        await x.stop()
        assert writes(sim, CONTROL)[-1] == (0x20,)
        assert not sim.moving(now())
        assert await x.move_to(1.0) == 1.0


@pytest.mark.parametrize("live", [False, True])
@virtual
async def test_a_jog_takes_another_speed(live: bool) -> None:
    sim = SimTlr(live_jog=live)
    async with stepper_on(sim, live_jog=live) as x:
        x.enable()
        await x.run(300)
        await x.run(600)
        assert await x.velocity() == 600
        assert ((0x20,) in writes(sim, CONTROL)) is not live
        await x.run(0)
        assert not sim.moving(now())
        await x.run(60)
        assert await x.move_to(1.0) == 1.0


@virtual
async def test_a_run_for_a_time_ends_by_itself_though_the_host_is_gone() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        x.enable()
        move = x.run(-120, duration=2.0)
        assert await move == pytest.approx(-4.0)
        assert now() - move.started_at == pytest.approx(2.06, abs=0.06)  # type: ignore[operator] # it was started
        # Too short to reach its speed.
        start = sim.shaft(now())
        short = x.run(600, acceleration=600, duration=0.5)
        await short
        assert sim.shaft(now()) - start == pytest.approx(600 / 60 * 0.5 * 0.5, abs=0.001)
        assert now() - short.started_at == pytest.approx(1.0, abs=0.1)  # type: ignore[operator] # it was started
        alone = x.run(600, duration=5.0)
        await asyncio.sleep(1.0)
        sim.receive, receive = (lambda frame, now: None), sim.receive  # type: ignore[method-assign]
        with pytest.raises(MoveFailed, match="stopped answering"):
            await alone
        await asyncio.sleep(5.0)
        assert not sim.moving(now())
        sim.receive = receive  # type: ignore[method-assign]
        x.stop()


@TRIGGERS
@pytest.mark.parametrize("emergency", [False, True])
@virtual
async def test_stops_work_again_and_again_though_their_bits_are_left_set(trigger: str, emergency: bool) -> None:
    """Also where only a rising bit counts, and nothing but stops is written: inputs move it."""
    sim = SimTlr(trigger=trigger, machine=TlrMachine(origin=None))  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        x.enable()
        await x.inputs.set(4, DiFunction.JOG_POSITIVE)
        for _ in range(5):
            sim.close(4, False, now())
            sim.close(4, True, now())
            await asyncio.sleep(0.5)
            assert sim.moving(now())
            seen = len(writes(sim, CONTROL))
            await (x.emergency_stop() if emergency else x.stop())
            assert not sim.moving(now())
            sent = writes(sim, CONTROL)[seen:]
            assert len(sent) <= 2
            assert all(word & 0x60 for (word,) in sent)


@virtual
async def test_a_stop_has_the_ramp_and_an_emergency_stop_has_none() -> None:
    for emergency in (False, True):
        sim = SimTlr()
        async with stepper_on(sim) as x:
            x.enable()
            move = x.move_to(100.0, rpm=600, acceleration=600)
            await asyncio.sleep(2.0)
            before = sim.shaft(now())
            await (x.emergency_stop() if emergency else x.stop())
            with pytest.raises(MoveCancelled):
                await move
            assert sim.shaft(now()) - before == pytest.approx(0.0 if emergency else 5.0, abs=0.1)
            words = [word for (word,) in writes(sim, CONTROL)]
            assert words[-1] == (0x40 if emergency else 0x20)
            assert await x.move_to(0.0) == 0.0


@pytest.mark.parametrize("lost", [1, 2])
@virtual
async def test_a_stop_that_is_lost_is_said_again(lost: int) -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        x.enable()
        await x.run(600)
        lose(sim, CONTROL, lost, heard=False)
        await x.stop()
        assert not sim.moving(now())


@virtual
async def test_leaving_the_bus_stops_it() -> None:
    sim = SimTlr()
    async with open_bus(VirtualLine(sim)) as bus:
        x = TlrStepper(bus, 1)
        x.enable()
        await x.run(600)
    assert not sim.moving(now())
    assert [halted.standing for halted in bus.stopped] == [True]


@virtual
async def test_the_emergency_stop_of_a_mixed_bus() -> None:
    tlr, mks = SimTlr(1), SimMks(2)
    async with open_bus(VirtualLine(tlr, mks)) as bus:
        x, y = TlrStepper(bus, 1), MksServo(bus, 2)
        for axis in (x, y):
            axis.enable()
            await axis.run(300)
        report = await bus.emergency_stop()
        assert str(report) == "TL-R 1 standing, MKS 2 standing"
        # The broadcast of the MKS family hurts no TL-R: it has no register there.
        assert any(record.request[:1] == b"\0" for record in bus.flight)
        bus.clear_emergency_stop()
        x.enable()
        assert await x.move_by(1.0)
        with pytest.raises(BroadcastConflict, match="0x0091 means something to MKS and TL-R devices"):
            await bus.broadcast.write_register(0x91, 1)


def test_what_it_hears_of_broadcasts() -> None:
    attached = TlrDrive(1, pulses_per_turn=4000)
    assert attached.hears(write_single(0, 0x4E, 3))
    assert attached.hears(write_single(0, 0x91, 1))
    assert attached.hears(write_multiple(0, 0x0F, [1, 2]))  # its second register is a setting
    assert not attached.hears(write_multiple(0, 0xE0, [1] * 32))
    assert not attached.hears(write_single(0, 0xF7, 1))
    assert not attached.hears(write_single(0, 0x04, 1))
    assert not attached.hears(read_holding(1, 0x4E, 1))
    assert attached.broadcast_stop() is None


# How standing is judged


def answer(*values: int) -> bytes:
    data = b"".join((value & 0xFFFF).to_bytes(2, "big") for value in values)
    body = bytes((1, 3, len(data))) + data
    return body + crc(body)


def test_its_reads_can_be_told_apart_by_their_length() -> None:
    attached = TlrDrive(1, pulses_per_turn=4000)
    reads = attached.reads()
    assert reads[0] == read(1, r.TELEMETRY)
    assert len({request.length for request in reads}) == len(reads) == 3
    assert attached.watchdog is None


@pytest.mark.parametrize(
    ("status", "rpm", "stands"), [(0, 0, True), (0, 2, True), (0, -3, False), (4, 0, False), (16, 0, True)]
)
def test_the_run_bit_and_the_speed_say_whether_it_stands(status: int, rpm: int, stands: bool) -> None:
    attached = TlrDrive(1, pulses_per_turn=4000)
    judge = attached.judgement(Motion())
    request = judge.ask(lambda request: True)
    assert request is attached.reads()[0]
    assert judge.see(request, answer(status, 0, 0, 0, 0, 5, rpm), 1.0) is stands


def test_without_a_speed_two_equal_positions_say_so() -> None:
    attached = TlrDrive(1, pulses_per_turn=4000)
    judge = attached.judgement(Motion())
    _, second, third = attached.reads()
    assert judge.ask(lambda request: request is second) is second
    assert judge.see(second, answer(0, 0, 0, 0, 0, 5), 1.0) is None
    assert judge.see(second, answer(0, 0, 0, 0, 0, 5), 1.02) is None
    assert judge.see(second, answer(0, 0, 0, 0, 0, 50), 1.1) is None
    assert judge.see(second, answer(0, 0, 0, 0, 0, 50), 1.2) is True
    assert judge.see(third, answer(4), 1.3) is False
    assert judge.see(third, answer(0), 1.4) is None


# No watchdog


@virtual
async def test_a_watchdog_is_refused_at_the_call_with_what_to_do_instead() -> None:
    async with open_bus(VirtualLine(SimTlr(1), SimMks(2))) as bus:
        x, y = TlrStepper(bus, 1), MksServo(bus, 2)
        with pytest.raises(NotSupported, match=r"TL-R 1 has no watchdog.*safety relay"):
            x.watchdog(1.0)
        with pytest.raises(NotSupported, match="TL-R 1 has no watchdog"):
            bus.watchdog(x, timeout=1.0)
        with pytest.raises(NotSupported, match="TL-R 1 has no watchdog"):
            bus.watchdog(y, x, timeout=1.0)
        assert bus.stats.units.get(2) is None


@virtual
async def test_a_stop_is_confirmed_though_the_usual_read_is_owed() -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=BusConfig(reply_timeout=0.02, late_reply_window=2.0)) as x:
        x.enable()
        await x.run(60)
        lose(sim, 0x04, heard=False, function=3)
        asking = asyncio.create_task(x.status())
        await asyncio.sleep(0.015)
        asking.cancel()
        begun = now()
        await x.stop()
        assert not sim.moving(now())
        assert now() - begun < 0.5
