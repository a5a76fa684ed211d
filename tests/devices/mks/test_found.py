"""What emulators written from the manual alone have found: nothing turns unseen, and what is said is so."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack, nullcontext, suppress
from typing import Any

import pytest

from rs485bus import MksServo
from rs485bus.bus.handle import Handle
from rs485bus.devices.mks import Model, Status, StopHoming, WorkMode
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.homing import SwitchHoming
from rs485bus.errors import (
    BusError,
    LimitExceeded,
    LimitReached,
    MotionError,
    MotorStalled,
    MoveFailed,
    NotEnabled,
    RearmRequired,
    ReferenceLost,
)
from rs485bus.motion.move import Move
from rs485bus.sim import Machine
from rs485bus.wire.frames import crc
from tests.devices.mks.bench import Bench, FlakyMks, bench, on_virtual_clock

RATES = [0, 5, 20, 50]
VERBS: dict[str, Callable[[MksServo], Move]] = {
    "move": lambda x: x.move_to(500.0, rpm=300),
    "run": lambda x: x.run(300),
    "timed run": lambda x: x.run(300, duration=20.0),
}


class LyingMks(FlakyMks):
    """A drive that says that it stands while it turns."""

    lies = False

    def receive(self, frame: bytes, now: float) -> bytes | None:
        reply = super().receive(frame, now)
        if self.lies and reply is not None and frame[:4] == bytes((self.address, 4, 0, r.STATUS.address)):
            reply = (body := bytes((self.address, 4, 2, 0, Status.STOPPED))) + crc(body)
        return reply


class QuietlyStallingMks(FlakyMks):
    """A drive whose shaft is held, and which reports full speed and no stall."""

    held = False

    def hold(self, now: float) -> None:
        self.held = True
        self.put_load(9999, now)
        self.motion.stalled = False

    def receive(self, frame: bytes, now: float) -> bytes | None:
        reply = super().receive(frame, now)
        self.motion.stalled = self.motion.stalled and not self.held
        if self.held and self.motion._pushing and frame[:4] == bytes((self.address, 4, 0, r.STATUS.address)):
            reply = (body := bytes((self.address, 4, 2, 0, Status.FULL_SPEED))) + crc(body)
        return reply


async def poll(x: MksServo, rate: float) -> None:
    """What an application does meanwhile."""
    while True:
        await asyncio.sleep(1 / rate)
        with suppress(BusError):
            await x.status()
            await x.position()


async def told_after(
    on: Bench, move: Handle[Any], event: Callable[[], Any], rate: float = 0, happens: Callable[[], bool] | None = None
) -> tuple[BusError, float]:
    """What somebody who waits is told, and how long after an event that comes 1 s into the motion, or by itself."""
    polling = asyncio.create_task(poll(on.axis, rate)) if rate else None
    if happens is None:
        await asyncio.sleep(1.0)
    while happens is not None and not happens():  # noqa: ASYNC110 - the virtual shaft tells nobody
        await asyncio.sleep(0.005)
    event()
    begun = on.bus.now()
    try:
        if move.done():  # it has reached its speed: whoever gives the next command is told
            for _ in range(300):
                await asyncio.sleep(0.01)
                on.axis._stops.queue.check()
        await move
    except BusError as error:
        return error, on.bus.now() - begun
    finally:
        if polling is not None:
            polling.cancel()
    raise AssertionError("nobody was told anything")


# What ends a motion is told then


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("verb", VERBS)
@on_virtual_clock
async def test_a_stall_in_a_motion_is_told_within_half_a_second(verb: str, rate: float) -> None:
    async with bench(FlakyMks()) as on:
        error, after = await told_after(on, VERBS[verb](on.axis), lambda: on.sim.put_load(9999, on.bus.now()), rate)
        assert isinstance(error, MotorStalled), error
        assert after <= 0.5
        on.sim.put_load(0, on.bus.now())
        await asyncio.sleep(1.0)
        assert not on.sim.moving(on.bus.now())  # it does not go on when it is let go


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("verb", VERBS)
@on_virtual_clock
async def test_a_blocked_shaft_that_reports_full_speed_is_stopped_within_half_a_second(verb: str, rate: float) -> None:
    sim = QuietlyStallingMks()
    async with bench(sim) as on:
        error, after = await told_after(on, VERBS[verb](on.axis), lambda: sim.hold(on.bus.now()), rate)
        assert isinstance(error, MotorStalled), error
        assert after <= 0.5
        sim.held = False
        sim.put_load(0, on.bus.now())
        await asyncio.sleep(2.0)
        assert not sim.moving(on.bus.now())
        assert on.sent(r.EMERGENCY_STOP) or on.sent(r.RUN)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("verb", VERBS)
@on_virtual_clock
async def test_a_protection_that_lets_go_is_told_within_half_a_second(verb: str, rate: float) -> None:
    async with bench(FlakyMks()) as on:
        error, after = await told_after(on, VERBS[verb](on.axis), lambda: on.sim.motion.protect(on.bus.now()), rate)
        assert isinstance(error, MotorStalled), error
        assert after <= 0.5


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("verb", VERBS)
@on_virtual_clock
async def test_a_motor_that_somebody_lets_go_of_is_told_within_half_a_second(verb: str, rate: float) -> None:
    async with bench(FlakyMks()) as on:
        error, after = await told_after(on, VERBS[verb](on.axis), lambda: on.sim._enable(False, on.bus.now()), rate)
        assert isinstance(error, NotEnabled | ReferenceLost), error
        assert after <= 0.5


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("verb", VERBS)
@on_virtual_clock
async def test_a_limit_in_a_motion_is_told_within_half_a_second_of_it(verb: str, rate: float) -> None:
    async with bench(FlakyMks(model=Model.SERVO57D, machine=Machine(right_switch=5.0))) as on:
        await on.axis.home(SwitchHoming(end_limits=True))
        error, after = await told_after(on, VERBS[verb](on.axis), lambda: None, rate, lambda: on.shaft > 4.999)
        assert isinstance(error, LimitReached), error
        assert after <= 0.5


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("verb", VERBS)
@on_virtual_clock
async def test_a_restart_in_a_motion_is_told_soon_after_the_drive_answers_again(verb: str, rate: float) -> None:
    async with bench(FlakyMks()) as on:
        error, after = await told_after(on, VERBS[verb](on.axis), lambda: on.sim.restart(on.bus.now()), rate)
        assert isinstance(error, ReferenceLost | MoveFailed), error
        assert after <= 0.6 + 0.5  # it is away for 0.6 s


# Restarts


async def jog(x: MksServo) -> None:
    await x.run(60)
    await x.stop()


@pytest.mark.parametrize("homed", [True, False])
@on_virtual_clock
async def test_a_restart_between_two_jogs_is_noticed_before_the_next_move(homed: bool) -> None:
    async with bench(FlakyMks(), limits=(-6.0, 6.0)) as on:
        if homed:
            await on.axis.home()
        else:
            await on.axis.move_to(3.0)
        await jog(on.axis)
        on.sim.restart(on.bus.now())
        await asyncio.sleep(1.0)
        with suppress(MotionError):
            await jog(on.axis)
        stands = on.shaft
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(5.0)
        assert on.shaft == stands


@on_virtual_clock
async def test_a_restart_inside_of_a_watchdog_block_has_the_register_written_again() -> None:
    async with bench(FlakyMks(), limits=(-6.0, 6.0)) as on, on.axis.watchdog(1.0):
        await on.axis.enable()
        await on.axis.home()
        await jog(on.axis)
        on.sim.restart(on.bus.now())
        on.sim.settings[r.WATCHDOG.address] = 0
        await asyncio.sleep(1.5)
        with pytest.raises((ReferenceLost, RearmRequired)):
            await on.axis.move_to(5.0)
        await on.axis.enable()
        assert on.sim.watchdog_ms == 1000


# Stops


@pytest.mark.parametrize("emergency", [False, True])
@on_virtual_clock
async def test_a_status_that_lies_confirms_no_stop(emergency: bool) -> None:
    sim = LyingMks()
    async with bench(sim) as on:
        await on.axis.run(300)
        sim.lies = True
        kinds = [r.EMERGENCY_STOP, r.RUN]
        for kind in kinds:
            sim.lose_request(kind)
        # Acknowledged by the echo of a gateway, say, and not heard by the drive.
        heard = sim.receive

        def swallow(frame: bytes, now: float) -> bytes | None:
            stop = frame[3] in (r.EMERGENCY_STOP.address, r.RUN.address) and frame[1] in (6, 16)
            if stop and frame not in swallowed:
                swallowed.append(frame)
                return frame if frame[1] == 6 else (body := frame[:6]) + crc(body)
            return heard(frame, now)

        swallowed: list[bytes] = []
        sim.lose_nothing()
        sim.receive = swallow  # type: ignore[method-assign]
        await (on.axis.emergency_stop() if emergency else on.axis.stop())
        stands = on.shaft
        await asyncio.sleep(2.0)
        assert on.shaft == pytest.approx(stands, abs=0.01)


@on_virtual_clock
async def test_to_look_at_a_stop_twice_is_no_repetition() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.move_to(2.0)
        await on.axis.run(60)
        await on.axis.stop()
        await on.axis.move_to(1.0)
        assert on.bus.stats.units[1].retries == 0


# Runs


@pytest.mark.parametrize("what", ["stall", "restart", "another master", "limit"])
@on_virtual_clock
async def test_a_run_for_a_time_that_was_cut_short_is_not_done(what: str) -> None:
    machine = Machine(right_switch=5.0) if what == "limit" else Machine()
    async with bench(FlakyMks(model=Model.SERVO57D, machine=machine)) as on:
        if what == "limit":
            await on.axis.home(SwitchHoming(end_limits=True))
        run = on.axis.run(300, duration=3.0)
        await asyncio.sleep(1.0)
        if what == "stall":
            on.sim.motion.protect(on.bus.now())
        elif what == "restart":
            on.sim.restart(on.bus.now())
        elif what == "another master":
            on.sim.motion.stop(1000.0, on.bus.now())
        with pytest.raises(MotionError):
            await run


@pytest.mark.parametrize("where", ["ramp", "speed"])
@pytest.mark.parametrize("how", ["lost", "refused"])
@on_virtual_clock
async def test_a_run_whose_reads_come_to_nothing_does_not_turn_on_unseen(how: str, where: str) -> None:
    sim = FlakyMks()
    # Nobody waits for the stop of one that has reached its speed: whoever leaves the bus is told that it was in vain.
    told = pytest.raises(ExceptionGroup) if where == "speed" else nullcontext()
    async with AsyncExitStack() as stack:
        stack.enter_context(told)
        on = await stack.enter_async_context(bench(sim))
        run = on.axis.run(300, acceleration=300)
        await asyncio.sleep(0.3 if where == "ramp" else 2.0)
        heard = sim.receive

        def deaf(frame: bytes, now: float) -> bytes | None:
            if frame[1] != 4:
                return heard(frame, now)
            return None if how == "lost" else (body := bytes((frame[0], 0x84, 4))) + crc(body)

        sim.receive = deaf  # type: ignore[method-assign]
        await asyncio.sleep(2.0)
        assert not sim.moving(on.bus.now())  # stops are heard
        sim.receive = heard  # type: ignore[method-assign]
        await asyncio.sleep(2.0)
        with pytest.raises(BusError):
            await run
            await on.axis.run(60)


@on_virtual_clock
async def test_a_speed_that_the_drive_cannot_be_told_is_refused_with_the_nearest() -> None:
    async with bench(FlakyMks()) as on:
        with pytest.raises(LimitExceeded, match="1 rpm"):
            on.axis.run(0.25)
        with pytest.raises(LimitExceeded):
            on.axis.move_to(1.0, rpm=1.4)
        with pytest.raises(LimitExceeded, match="acceleration"):
            on.axis.move_to(1.0, acceleration=15_000.0)  # 10,000 or 20,000
        on.axis.move_to(1.0, rpm=299.9)
    async with bench(FlakyMks(microsteps=1), microsteps=1) as on:
        with pytest.raises(LimitExceeded, match="16 rpm"):
            on.axis.run(1)


@pytest.mark.parametrize("duration", [None, 10.0])
@pytest.mark.parametrize("rpm", [300, -300, 50])
@on_virtual_clock
async def test_a_run_is_stopped_by_its_ramp_before_it_leaves_the_limits(rpm: float, duration: float | None) -> None:
    async with bench(FlakyMks(), limits=(-3.0, 6.0)) as on:
        run = on.axis.run(rpm, duration=duration)
        for _ in range(3000):
            await asyncio.sleep(0.01)
            assert -3.0 <= on.shaft <= 6.0
        assert not on.sim.moving(on.bus.now())
        if duration is None:
            await run
            with pytest.raises(LimitReached, match="would leave its limits"):
                await on.axis.move_to(0.0)
        else:
            with pytest.raises(LimitReached, match="would leave its limits"):
                await run
        assert not on.sent(r.EMERGENCY_STOP)
        await on.axis.move_to(6.0 if rpm > 0 else -3.0)
        with pytest.raises(LimitReached, match="stands at the end of its limits"):
            await on.axis.run(rpm)
        await on.axis.run(-rpm)
        await on.axis.stop()


# In position


@on_virtual_clock
async def test_an_axis_that_settles_within_a_degree_has_arrived() -> None:
    async with bench(FlakyMks(machine=Machine(following_error=13))) as on:  # 0.3°
        for turn in range(10):
            await on.axis.move_to(float(turn))


@on_virtual_clock
async def test_one_that_does_not_is_told_how_far_it_is_and_how_to_allow_that() -> None:
    async with bench(FlakyMks(machine=Machine(following_error=100))) as on:
        with pytest.raises(MoveFailed, match=r"100 counts short .* tolerance of 45.* tolerance=200"):
            await on.axis.move_to(1.0)
    async with bench(FlakyMks(machine=Machine(following_error=100)), tolerance=200) as on:
        await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_tolerance_of_zero_means_zero() -> None:
    async with bench(FlakyMks(machine=Machine(following_error=1)), tolerance=0) as on:
        with pytest.raises(MoveFailed, match="tolerance"):
            await on.axis.move_to(1.0)
    async with bench(FlakyMks(), tolerance=0) as on:
        await on.axis.move_to(1.0)


# Settings and messages


@on_virtual_clock
async def test_homing_against_a_stop_leaves_end_limits_on() -> None:
    machine = Machine(travel=(-3.0, 100.0), right_switch=50.0)
    async with bench(FlakyMks(machine=machine)) as on:
        await on.axis.home(SwitchHoming(end_limits=True))
        assert on.sim.motion.limited
        await on.axis.home(StopHoming())
        assert on.sim.motion.limited


@on_virtual_clock
async def test_a_fresh_drive_is_said_to_be_in_the_wrong_mode() -> None:
    async with bench(FlakyMks(mode=WorkMode.CR_VFOC), enable=False) as on:
        with pytest.raises(NotEnabled, match=r"CR_vFOC: set_mode\(WorkMode.SR_VFOC\)"):
            await on.axis.enable()


@on_virtual_clock
async def test_a_status_that_no_manual_names_is_unknown_and_no_error() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        heard = sim.receive

        def odd(frame: bytes, now: float) -> bytes | None:
            if frame[:4] == bytes((1, 4, 0, r.STATUS.address)):
                return (body := bytes((1, 4, 2, 0, 7))) + crc(body)
            return heard(frame, now)

        sim.receive = odd  # type: ignore[method-assign]
        assert await on.axis.motor_status() == 7
        assert (await on.axis.status()).moving in (True, False)
        await on.axis.move_to(1.0)
        await on.axis.stop()
