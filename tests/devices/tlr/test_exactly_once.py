"""A move happens exactly once, whatever the line loses and whenever the drive restarts; what is not settled says so."""

import asyncio

import pytest

from rs485bus import BusConfig, MoveState
from rs485bus.devices.tlr import Homing, HomingMode
from rs485bus.devices.tlr import registers as r
from rs485bus.errors import (
    DeviceRefused,
    MotionError,
    MoveCancelled,
    MoveFailed,
    NoReply,
    NotEnabled,
    OutcomeUnknown,
    RearmRequired,
    ReferenceLost,
    StopUnconfirmed,
)
from rs485bus.sim import Noise, SimTlr
from rs485bus.wire.frames import crc
from tests.devices.tlr.support import TRIGGERS, lose, now, restart_at_once, stepper_on, writes
from tests.integration.support import virtual

CONTROL = r.CONTROL.address
BLOCK = r.POSITIONING.address
HERE = Homing(mode=HomingMode.HERE)


@TRIGGERS
@pytest.mark.parametrize("heard", [True, False])
@virtual
async def test_a_relative_move_whose_trigger_or_its_answer_is_lost_moves_once(trigger: str, heard: bool) -> None:
    sim = SimTlr(shaft=0.5, trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        await x.enable()
        lost = lose(sim, CONTROL, heard=heard, value=3)
        assert await x.move_by(2.0) == 2.0
        assert sim.shaft(now()) == pytest.approx(2.5)
        assert sim.moves == 1
        assert len(lost) == 1


@TRIGGERS
@virtual
async def test_a_trigger_that_is_lost_three_times_is_not_taken_for_a_move(trigger: str) -> None:
    sim = SimTlr(trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        await x.enable()
        lose(sim, CONTROL, 3, heard=False, value=3)
        move = x.move_by(2.0)
        with pytest.raises(OutcomeUnknown):
            await move
        assert move.state is MoveState.FAILED
        assert sim.moves == 0
        assert await x.move_by(2.0) == 2.0


@TRIGGERS
@virtual
async def test_a_move_so_short_that_it_is_over_before_anybody_looks_happens_once(trigger: str) -> None:
    sim = SimTlr(trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        await x.enable()
        lose(sim, CONTROL, heard=True, value=3)
        assert await x.move_by(0.02) == 0.02
        assert sim.shaft(now()) == pytest.approx(0.02)
        assert sim.moves == 1


@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize("truncates", [None, 4])
@virtual
async def test_a_lost_target_is_written_again(heard: bool, truncates: int | None) -> None:
    sim = SimTlr(truncates=truncates)
    async with stepper_on(sim) as x:
        await x.enable()
        lose(sim, BLOCK, heard=heard, function=16)
        lose(sim, BLOCK + 5, heard=heard)
        assert await x.move_by(30.0) == 30.0
        assert sim.moves == 1


@pytest.mark.parametrize("trigger", ["edge", "write"])
@pytest.mark.parametrize("seed", range(4))
@virtual
async def test_moves_on_a_bad_line_end_where_they_should(seed: int, trigger: str) -> None:
    noise = Noise(lost_request=0.03, lost_reply=0.03, flipped=0.02, torn=0.01, stray=0.02, duplicated=0.01)
    sim = SimTlr(trigger=trigger, truncates=(None, 4)[seed % 2])  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim, noise=noise, seed=seed) as x:
        x.enable()
        for _ in range(25):
            x.move_by(0.25)
        await x.drain()
        assert sim.shaft(now()) == pytest.approx(6.25, abs=0.002)


@virtual
async def test_a_status_polled_before_a_move_and_answered_late_never_ends_it() -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=BusConfig(reply_timeout=0.02)) as x:
        await x.enable()
        answer = sim.answer

        def late_once(pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
            sim.answer = answer  # type: ignore[method-assign]
            sim.turnaround = 0.05
            return answer(pdu, now, broadcast=broadcast)

        sim.answer = late_once  # type: ignore[method-assign]
        with pytest.raises(NoReply):
            await x.bus.unit(1).read_holding_registers(4, 7, timeout=0.01)
        sim.turnaround = None
        assert await x.move_to(5.0) == 5.0
        assert sim.shaft(now()) == pytest.approx(5.0)
        assert x.bus.stats.units[1].late_replies >= 1


# The drive restarts


@pytest.mark.parametrize("stood_at", [3.0, 0.0])
@virtual
async def test_a_drive_that_restarted_between_two_moves_has_lost_its_reference(stood_at: float) -> None:
    """At zero, too, where its position does not show it; and while it was off the load has sunk."""
    sim = SimTlr(enabled_bit=True)
    async with stepper_on(sim) as x:
        x.enable()
        x.move_to(1.0)
        await x.move_to(stood_at)
        sim.power_cycle(now(), dropped=-0.7)
        await asyncio.sleep(2.0)
        shaft = sim.shaft(now())
        with pytest.raises(ReferenceLost, match="has restarted"):
            await x.move_to(4.0)
        with pytest.raises(ReferenceLost):
            await x.move_by(1.0)
        await x.set_zero()
        with pytest.raises(NotEnabled):
            await x.move_to(1.0)
        await x.enable()
        assert await x.move_to(1.0) == 1.0
        assert sim.shaft(now()) == pytest.approx(shaft + 1.0)


@virtual
async def test_a_restart_is_noticed_before_the_first_move_and_after_saving_too() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.enable()
        await x.home(HERE)
        sim.power_cycle(now(), dropped=-0.7)
        await asyncio.sleep(2.0)
        with pytest.raises(ReferenceLost):
            await x.move_to(0.0)
        await x.enable()
        await x.home(HERE)
        await x.move_to(0.1)
        x.move_to(0.0)
        await x.save()
        sim.power_cycle(now(), dropped=-0.7)
        await asyncio.sleep(2.0)
        with pytest.raises(ReferenceLost):
            await x.move_to(0.0)


@pytest.mark.parametrize("block", [True, False])
@virtual
async def test_a_restart_while_the_target_is_written_starts_nothing(block: bool) -> None:
    """What it holds then is what nobody wrote, and is read before anything is written again."""
    sim = SimTlr()
    async with stepper_on(sim, block_writes=block) as x:
        x.enable()
        await x.move_to(0.5)
        await x.set_zero()
        at, function = (r.POSITIONING.address, 16) if block else (r.TARGET.address + 1, 6)
        lose(sim, at, heard=False, function=function, after=lambda at: restart_at_once(sim))
        moves = sim.moves
        with pytest.raises(ReferenceLost if block else (ReferenceLost, DeviceRefused)):
            await x.move_to(0.3)
        assert sim.moves == moves
        with pytest.raises(ReferenceLost):
            await x.move_to(0.3)


@pytest.mark.parametrize("at", [CONTROL, BLOCK])
@virtual
async def test_a_drive_that_restarts_after_it_has_said_that_it_is_busy_does_not_go_by_its_new_zero(at: int) -> None:
    """All that it is asked it answers."""
    sim, says = SimTlr(), iter((False, False, False, True))
    async with stepper_on(sim, config=BusConfig(retries=4)) as x:
        await x.enable()
        await x.move_to(5.0)
        receive = sim.receive

        def busy(frame: bytes, now: float) -> bytes | None:
            mine = frame[1] in (6, 16) and int.from_bytes(frame[2:4], "big") == at
            restarts = next(says, None) if mine else None
            if restarts:
                restart_at_once(sim)
            refusal = bytes((1, frame[1] | 0x80, 6))
            return receive(frame, now) if restarts is None else refusal + crc(refusal)

        sim.receive = busy  # type: ignore[method-assign]
        with pytest.raises(ReferenceLost):
            await x.move_to(6.0)
        assert sim.shaft(now()) == pytest.approx(5.0)


@virtual
async def test_a_subdivision_that_a_restart_took_back_before_it_was_enabled_is_read_again() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.set_subdivision(8000)
        await x.position()
        sim.power_cycle(now())
        await asyncio.sleep(2.0)
        x.enable()
        x.set_zero()
        begun_at = sim.shaft(now())
        assert await x.move_to(0.4) == 0.4
        assert sim.shaft(now()) == pytest.approx(begun_at + 0.4)


@virtual
async def test_a_jog_whose_start_was_lost_after_another_one_was_stopped_is_told_again() -> None:
    """The way that it went until it stood is no sign that the start was taken."""
    sim = SimTlr()
    async with stepper_on(sim) as x:
        x.enable()
        await x.run(120)
        await asyncio.sleep(0.2)
        lose(sim, CONTROL, heard=False, value=8)
        await x.run(180)
        assert await x.velocity() == 180
        await x.stop()


@virtual
async def test_enabling_does_not_hide_a_restart() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.enable()
        await x.set_zero()
        sim.power_cycle(now(), dropped=-0.7)
        await asyncio.sleep(2.0)
        await x.enable()
        with pytest.raises(ReferenceLost, match="has restarted"):
            await x.move_to(1.0)
        assert sim.moves == 0


@TRIGGERS
@pytest.mark.parametrize("target", [10.0, 0.0])
@pytest.mark.parametrize("begins_at", [3.0, 0.0])
@virtual
async def test_a_drive_that_restarted_at_the_trigger_does_not_travel(
    trigger: str, target: float, begins_at: float
) -> None:
    """The motor starts, the supply breaks down, and the drive is there again, at zero, when it is asked."""
    sim = SimTlr(trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        x.enable()
        x.move_to(1.0)
        await x.move_to(begins_at)
        lose(sim, CONTROL, heard=True, value=3, after=lambda at: restart_at_once(sim))
        moves = sim.moves
        shaft = sim.shaft(now())
        with pytest.raises((ReferenceLost, OutcomeUnknown)):
            await x.move_to(target)
        await asyncio.sleep(3.0)
        assert sim.shaft(now()) == pytest.approx(shaft, abs=0.01)
        assert sim.moves <= moves + 1
        with pytest.raises(MotionError):
            await x.move_to(target)
        x.enable()
        with pytest.raises(ReferenceLost):
            await x.move_to(target)
        assert sim.shaft(now()) == pytest.approx(shaft, abs=0.01)


@pytest.mark.parametrize("target", [20.0, 0.0])
@virtual
async def test_a_drive_that_restarts_in_the_middle_has_not_arrived(target: float) -> None:
    """Not even where it is to go to zero, and then counts from there."""
    sim = SimTlr(shaft=0.0)
    async with stepper_on(sim) as x:
        x.enable()
        await x.move_to(10.0)
        move = x.move_to(target)
        await asyncio.sleep(0.5)
        sim.power_cycle(now())
        with pytest.raises((ReferenceLost, MoveFailed)):
            await move
        with pytest.raises((ReferenceLost, RearmRequired)):
            await x.move_to(1.0)
        await x.enable()
        with pytest.raises(ReferenceLost):
            await x.move_to(1.0)


@virtual
async def test_where_targets_are_used_up_a_jump_of_the_position_still_shows_a_restart() -> None:
    sim = SimTlr(keeps_target=False)
    async with stepper_on(sim, keeps_target=False) as x:
        x.enable()
        assert await x.move_to(3.0) == 3.0
        assert await x.move_to(5.0) == 5.0
        sim.power_cycle(now())
        await asyncio.sleep(2.0)
        with pytest.raises(ReferenceLost, match="nobody moved it"):
            await x.move_to(4.0)


@virtual
async def test_a_drive_that_uses_its_targets_up_is_not_trusted_by_default() -> None:
    sim = SimTlr(keeps_target=False)
    async with stepper_on(sim) as x:
        await x.enable()
        with pytest.raises(ReferenceLost):
            await x.move_to(3.0)


@virtual
async def test_an_answer_lost_while_the_target_was_written_does_not_look_like_a_restart() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.enable()
        await x.move_to(1.0)
        receive = sim.receive
        lose(sim, BLOCK, 3, heard=True)
        with pytest.raises(NoReply):
            # Nothing can be read back either.
            lose(sim, BLOCK, 9, heard=False, function=3)
            await x.move_to(7.0)
        await asyncio.sleep(1.0)
        sim.receive = receive  # type: ignore[method-assign]
        assert await x.move_to(8.0) == 8.0


# The drive falls silent


@pytest.mark.parametrize("restarts", [False, True])
@virtual
async def test_a_drive_that_falls_silent_is_stopped_and_moves_only_after_enable(restarts: bool) -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=BusConfig(reply_timeout=0.02)) as x:
        x.enable()
        move = x.move_to(10.0)
        await asyncio.sleep(0.5)
        receive, sim.receive = sim.receive, lambda frame, now: None  # type: ignore[method-assign]
        with pytest.raises(MoveFailed, match="stopped answering"):
            await move
        sim.receive = receive  # type: ignore[method-assign]
        await asyncio.sleep(20.0)
        assert not sim.moving(now())
        with pytest.raises(RearmRequired):
            await x.move_to(0.0)
        if restarts:
            sim.power_cycle(now())
        await x.enable()
        if restarts:
            with pytest.raises(ReferenceLost):
                await x.move_to(0.0)
            await x.home(HERE)
        assert await x.move_to(1.0) == 1.0


@virtual
async def test_a_move_of_which_nobody_knows_whether_it_began_is_stopped() -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=BusConfig(reply_timeout=0.02)) as x:
        await x.enable()
        receive = sim.receive

        def deaf(now: float) -> None:
            sim.receive = lambda frame, now: None  # type: ignore[method-assign]

        lose(sim, CONTROL, heard=True, value=3, after=deaf)
        moving = asyncio.create_task(x.move_to(1000.0).wait())
        await asyncio.sleep(1.0)
        sim.receive = receive  # type: ignore[method-assign]
        with pytest.raises(OutcomeUnknown):
            await moving
        await asyncio.sleep(10.0)
        assert not sim.moving(now())
        with pytest.raises(RearmRequired):
            await x.move_to(1.0)
        await x.enable()
        assert await x.move_to(1.0) == 1.0


@virtual
async def test_after_the_port_was_lost_the_first_frame_is_a_stop_and_the_setup_is_done_anew() -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=BusConfig(reopen_min=0.1)) as x:
        x.enable()
        moving = x.move_to(1000.0)
        await asyncio.sleep(1.0)
        line = x.bus._transport
        line.unplug()  # type: ignore[attr-defined] # the virtual line
        await asyncio.sleep(0.05)
        with pytest.raises(Exception, match="the port was lost"):
            await moving
        seen = len(x.bus.flight)
        line.plug()  # type: ignore[attr-defined] # the virtual line
        await asyncio.sleep(2.0)
        assert not sim.moving(now())
        assert x.bus.flight[seen].request[:6] == bytes((1, 6, 0, CONTROL, 0, 0x40))
        sim.memory.set(r.SUBDIVISION, 8000)
        assert await x.move_by(1.0)
        assert x.counts_per_turn == 8000


@virtual
async def test_a_move_that_is_cancelled_while_its_target_is_written_never_starts() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.enable()
        for pause in range(1, 30):
            move = x.move_by(50.0)
            await asyncio.sleep(pause / 1000)
            stop = x.stop()
            moves = sim.moves
            with pytest.raises(MoveCancelled):
                await move
            await stop
            assert not sim.moving(now())
            await asyncio.sleep(0.1)
            assert sim.moves == moves or not sim.moving(now())
        assert writes(sim, CONTROL)[-1][0] & 0x60


@virtual
async def test_a_stop_that_cannot_be_confirmed_says_so() -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=BusConfig(close_timeout=0.5)) as x:
        x.enable()
        await x.run(60)
        sim._control = lambda word, before, now: None  # type: ignore[method-assign]
        with pytest.raises(StopUnconfirmed):
            await x.stop()
        del sim._control  # the real one again
        await asyncio.sleep(5.0)
        assert not sim.moving(now())
        with pytest.raises(RearmRequired):
            await x.move_to(1.0)
