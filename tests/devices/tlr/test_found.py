"""What emulators written from the manual alone have found: nothing turns unseen, and what is said is so."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from rs485bus import BusConfig, MoveState, TlrStepper
from rs485bus.devices.tlr import DiFunction, Homing, HomingMode, Path
from rs485bus.devices.tlr import registers as r
from rs485bus.errors import (
    BusError,
    DriveFault,
    HomingFailed,
    LimitExceeded,
    LimitReached,
    MoveFailed,
    NoReply,
    ReferenceLost,
    StopUnconfirmed,
)
from rs485bus.motion.move import Move
from rs485bus.sim import SimTlr, TlrMachine
from rs485bus.wire.frames import crc
from tests.devices.tlr.support import lose, now, restart_at_once, stepper_on, writes
from tests.integration.support import virtual

CONTROL = r.CONTROL.address
STATUS = r.STATUS.address
FAST = BusConfig(reply_timeout=0.02)
VERBS: dict[str, Callable[[TlrStepper], Move]] = {
    "move": lambda x: x.move_to(100.0, rpm=300),
    "run": lambda x: x.run(300),
    "timed run": lambda x: x.run(300, duration=20.0),
    "home": lambda x: x.home(Homing(mode=HomingMode.POSITIVE_ORIGIN, rpm=300)),
}


def refuse(sim: SimTlr, function: int, times: int, code: int = 4) -> None:
    """Answer the next requests of a function by an exception."""
    receive, left = sim.receive, [times]

    def refusing(frame: bytes, at: float) -> bytes | None:
        if frame[1] != function or not left[0]:
            return receive(frame, at)
        left[0] -= 1
        body = bytes((frame[0], frame[1] | 0x80, code))
        return body + crc(body)

    sim.receive = refusing  # type: ignore[method-assign]


async def poll(x: TlrStepper, rate: float) -> None:
    """What an application does meanwhile."""
    while True:
        await asyncio.sleep(1 / rate)
        with pytest.MonkeyPatch.context():
            try:
                await x.status()
                await x.position()
            except BusError:
                pass


async def told_after(x: TlrStepper, move: Move, event: Callable[[], Any], rate: float) -> tuple[BusError, float]:
    """What somebody who waits is told, and how long after an event that comes 1 s into the motion."""
    polling = asyncio.create_task(poll(x, rate)) if rate else None
    await asyncio.sleep(1.0)
    event()
    begun = now()
    try:
        if move.done():  # it has reached its speed: whoever gives the next command is told
            for _ in range(300):
                await asyncio.sleep(0.01)
                x._stops.queue.check()
        await move
    except BusError as error:
        return error, now() - begun
    finally:
        if polling is not None:
            polling.cancel()
    raise AssertionError("nobody was told anything")


@pytest.mark.parametrize("rate", [0, 5, 20, 50])
@pytest.mark.parametrize("verb", list(VERBS))
@virtual
async def test_a_fault_in_a_motion_is_told_within_half_a_second(verb: str, rate: float) -> None:
    sim = SimTlr(machine=TlrMachine(origin=None), shaft=0.0)
    async with stepper_on(sim) as x:
        await x.enable()
        error, seconds = await told_after(x, VERBS[verb](x), lambda: sim.fail(5, now()), rate)
        assert isinstance(error, DriveFault)
        assert seconds <= 0.5
        assert not sim.moving(now())


@pytest.mark.parametrize("rate", [0, 20])
@pytest.mark.parametrize("verb", list(VERBS))
@virtual
async def test_a_restart_in_a_motion_is_told_within_half_a_second(verb: str, rate: float) -> None:
    sim = SimTlr(machine=TlrMachine(origin=None))
    async with stepper_on(sim) as x:
        await x.enable()
        error, seconds = await told_after(x, VERBS[verb](x), lambda: restart_at_once(sim), rate)
        assert isinstance(error, ReferenceLost)
        assert seconds <= 0.5


@pytest.mark.parametrize("rate", [0, 20])
@pytest.mark.parametrize("verb", ["move", "run", "timed run"])
@virtual
async def test_a_limit_in_a_motion_is_told_within_half_a_second_and_its_input_named(verb: str, rate: float) -> None:
    sim = SimTlr(machine=TlrMachine(origin=None))
    async with stepper_on(sim) as x:
        await x.enable()
        error, seconds = await told_after(x, VERBS[verb](x), lambda: sim.close(1, True, now()), rate)
        assert isinstance(error, LimitReached)
        assert "DI1 (POSITIVE_LIMIT)" in str(error)
        assert seconds <= 0.5


@pytest.mark.parametrize("function", [DiFunction.STOP, DiFunction.EMERGENCY_STOP, DiFunction.RELEASE])
@virtual
async def test_a_run_that_an_input_ends_is_told_with_the_inputs(function: DiFunction) -> None:
    sim = SimTlr(machine=TlrMachine(origin=None))
    async with stepper_on(sim) as x:
        x.enable()
        await x.inputs.set(4, function)
        error, seconds = await told_after(x, x.run(300), lambda: sim.close(4, True, now()), 0)
        assert isinstance(error, MoveFailed)
        assert "inputs <Ports.PORT_4: 16>" in str(error)
        assert seconds <= 0.7  # its ramp is a part of that


@virtual
async def test_a_jog_into_a_limit_switch_of_the_machine_names_the_input() -> None:
    sim = SimTlr(machine=TlrMachine(origin=None, limits=(-5.0, 6.0)))
    async with stepper_on(sim) as x:
        x.enable()
        run = x.run(-300)
        await run
        with pytest.raises(LimitReached, match=r"DI2 \(NEGATIVE_LIMIT\)"):
            for _ in range(40):
                await asyncio.sleep(0.1)
                x._stops.queue.check()
        # Off it the other way, and no false alarm there.
        await x.enable()
        assert await x.move_to(1.0) == 1.0


@pytest.mark.parametrize("lost", [3, 5])
@virtual
async def test_a_run_whose_reads_are_lost_is_stopped_or_goes_on_supervised(lost: int) -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=FAST) as x:
        await x.enable()
        run = x.run(120, acceleration=60)  # 2 s
        await asyncio.sleep(0.3)
        lose(sim, STATUS, lost, heard=True, function=3)
        await run
        assert await x.velocity() == pytest.approx(120, abs=4)
        # It is looked at still.
        sim.fail(1, now())
        await asyncio.sleep(0.5)
        with pytest.raises(DriveFault):
            x._stops.queue.check()


@virtual
async def test_a_run_whose_drive_is_deaf_during_the_ramp_is_stopped_as_soon_as_it_hears_again() -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=FAST) as x:
        await x.enable()
        run = x.run(120, acceleration=60)
        await asyncio.sleep(0.3)
        receive, sim.receive = sim.receive, lambda frame, now: None  # type: ignore[method-assign]
        with pytest.raises(MoveFailed, match="stopped answering"):
            await run
        sim.receive = receive  # type: ignore[method-assign]
        await asyncio.sleep(3.0)
        assert not sim.moving(now())


@pytest.mark.parametrize("code", [2, 4, 6])
@virtual
async def test_a_run_whose_reads_are_answered_by_exceptions_does_not_turn_on_unseen(code: int) -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=FAST) as x:
        await x.enable()
        run = x.run(120, acceleration=60)
        await asyncio.sleep(0.3)
        receive = sim.receive
        refuse(sim, 3, 10**6, code)
        with pytest.raises(BusError):
            await run
        await asyncio.sleep(1.0)
        assert not sim.moving(now())
        sim.receive = receive  # type: ignore[method-assign]


@virtual
async def test_a_bus_is_closed_in_time_though_a_drive_never_says_that_it_stands(
    caplog: pytest.LogCaptureFixture,
) -> None:
    sim = SimTlr()
    with pytest.raises(ExceptionGroup) as closing:
        async with stepper_on(sim, config=BusConfig(reply_timeout=0.02, close_timeout=1.0)) as x:
            x.enable()
            await x.run(120)
            refuse(sim, 3, 10**6, 4)
            x.stop()
    assert closing.group_contains(StopUnconfirmed)
    assert not sim.moving(now())
    assert "RecursionError" not in caplog.text


@pytest.mark.parametrize("pulses", [5, 92])
@virtual
async def test_a_short_move_whose_trigger_does_nothing_is_not_done(pulses: int) -> None:
    """At 51200 pulses a turn 92 of them are within the tolerance."""
    sim = SimTlr(subdivision=51200, denies=False)
    async with stepper_on(sim, units_per_turn=51200) as x:
        await x.enable()
        sim.motion.enabled = False  # an input has let go of it
        move = x.move_by(pulses)
        with pytest.raises(MoveFailed):
            await move
        assert move.state is MoveState.FAILED


@virtual
async def test_a_short_move_whose_trigger_is_lost_is_made_all_the_same() -> None:
    sim = SimTlr(subdivision=51200)
    async with stepper_on(sim, units_per_turn=51200) as x:
        await x.enable()
        lose(sim, CONTROL, heard=False, value=3)
        assert await x.move_by(92) == pytest.approx(92, abs=2)
        assert sim.shaft(now()) == pytest.approx(92 / 51200, abs=0.0005)
        assert sim.moves == 1


@virtual
async def test_a_tolerance_of_zero_means_zero() -> None:
    for error in (0, 3):
        sim = SimTlr(machine=TlrMachine(following_error=error))
        async with stepper_on(sim, tolerance=0) as x:
            await x.enable()
            assert x.tolerance == 0
            if error:
                with pytest.raises(MoveFailed, match="tolerance"):
                    await x.move_to(1.0)
            else:
                assert await x.move_to(1.0) == 1.0


@virtual
async def test_another_subdivision_holds_though_pulses_per_turn_were_given() -> None:
    sim = SimTlr(subdivision=4000)
    async with stepper_on(sim, pulses_per_turn=4000) as x:
        x.enable()
        await x.set_subdivision(8000)
        await x.set_zero()
        assert await x.move_to(2.0) == 2.0
        assert sim.shaft(now()) == pytest.approx(2.0)
        assert x.counts_per_turn == 8000


@virtual
async def test_a_subdivision_that_somebody_else_writes_is_noticed() -> None:
    sim = SimTlr(subdivision=4000)
    async with stepper_on(sim) as x:
        x.enable()
        await x.move_to(1.0)
        await x.bus.unit(1).write_register(r.SUBDIVISION.address, 8000)
        with pytest.raises(ReferenceLost, match="subdivision was changed"):
            await x.move_to(2.0)
        await x.set_zero()
        assert await x.move_to(2.0) == 2.0
        assert sim.shaft(now()) == pytest.approx(3.0)


@pytest.mark.parametrize("ends", ["timeout", "limit", "stop", "does not start"])
@virtual
async def test_after_a_homing_that_found_nothing_positions_are_not_trusted(ends: str) -> None:
    sim = SimTlr(shaft=1.0, machine=TlrMachine(origin=None, limits=(-50.0, 50.0)), denies=False)
    homing = Homing(mode=HomingMode.POSITIVE_ORIGIN, rpm=300 if ends != "limit" else 3000)
    async with stepper_on(sim) as x:
        await x.enable()
        await x.set_zero()
        if ends == "does not start":
            sim.motion.enabled = False
        home = x.home(homing, timeout=3.0 if ends == "timeout" else 60.0)
        if ends == "stop":
            await asyncio.sleep(1.0)
            await x.stop()
        with pytest.raises(BusError):
            await home
        assert isinstance(home.error, HomingFailed) or ends == "stop"
        assert not sim.moving(now())
        await x.enable()
        with pytest.raises(ReferenceLost, match="homing did not find the origin"):
            await x.move_to(1.0)
        await x.set_zero()
        assert await x.move_to(-1.0) == -1.0


@virtual
async def test_a_question_is_answered_when_what_was_set_before_is_written() -> None:
    sim = SimTlr(machine=TlrMachine(origin=None))
    async with stepper_on(sim) as x:
        x.paths[3] = Path(1.0, 100)
        x.paths[3] = Path(2.0, 200)
        assert await x.paths[3] == Path(2.0, 200)
        x.inputs[2] = DiFunction.STOP
        assert await x.inputs[2] is DiFunction.STOP
        x.write(r.HOMING_SPEED, 77)
        assert await x.read(r.HOMING_SPEED) == 77


@virtual
async def test_a_question_is_answered_though_what_was_set_before_fails() -> None:
    sim = SimTlr()
    async with stepper_on(sim, config=FAST) as x:
        await x.set_up()
        lose(sim, r.HOMING_SPEED.address, 9, heard=False, function=6)
        setting = x.write(r.HOMING_SPEED, 77)
        assert await x.read(r.HOMING_SPEED) == 60
        with pytest.raises(NoReply):
            await setting


@virtual
async def test_up_and_down_have_ramps_of_their_own() -> None:
    sim = SimTlr()
    async with stepper_on(sim, deceleration=500) as x:
        await x.enable()
        move = x.move_to(20.0, rpm=600, acceleration=3000)
        await move
        assert writes(sim, r.POSITIONING.address)[-1][:4] == (0, 200, 1200, 600)
        assert move.eta is not None
        assert abs(now() - move.eta) < 0.1
        await x.move_by(1.0, rpm=600, acceleration=600, deceleration=1200)
        assert writes(sim, r.POSITIONING.address)[-1][:4] == (0, 1000, 500, 600)
        await x.run(300, acceleration=1500, deceleration=300)
        assert writes(sim, r.JOG.address)[-1] == (300, 200, 1000)
        begun = now()
        await x.run(0)
        assert now() - begun == pytest.approx(1.0, abs=0.2)
        start = await x.position()
        timed = x.run(300, acceleration=1500, deceleration=300, duration=1.0)
        assert await timed - start == pytest.approx(5 * 0.9 + 5 * 0.5, abs=0.01)
        with pytest.raises(LimitExceeded, match=r"deceleration 100 rpm/s is below 300 rpm/s"):
            x.move_to(0.0, rpm=600, deceleration=100)


@virtual
async def test_a_stop_has_the_time_of_the_ramp_down() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        x.enable()
        await x.run(600, acceleration=6000, deceleration=300)
        begun = now()
        await x.stop()
        assert now() - begun == pytest.approx(2.0, abs=0.2)
        assert [word for (word,) in writes(sim, CONTROL)][-1] == 0x20  # said once


@pytest.mark.parametrize("by_level", [True, False])
@virtual
async def test_one_that_jogs_goes_on_when_it_is_enabled_once_more(by_level: bool) -> None:
    sim = SimTlr(jog_by_level=by_level)
    async with stepper_on(sim) as x:
        await x.enable()
        await x.run(60)
        await x.enable()
        await asyncio.sleep(1.0)
        sim.motion.advance(now())
        assert sim.motion.motor.rpm(now()) == pytest.approx(60)
        assert await x.stop() is None
        await x.move_to(2.0)
