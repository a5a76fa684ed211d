"""Restarts, silence, and what a drive does at power-on."""

import anyio
import pytest

from rs485bus.devices.mks import WorkMode
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import Status
from rs485bus.errors import (
    MotionError,
    NotStanding,
    OutcomeUnknown,
    RearmRequired,
    ReferenceLost,
)
from tests.devices.mks.bench import FlakyMks, bench, on_virtual_clock


@pytest.mark.parametrize("verb", ["restart", "calibrate", "factory_reset"])
@on_virtual_clock
async def test_a_restarted_drive_is_waited_for_and_has_lost_its_reference(verb: str) -> None:
    async with bench(FlakyMks(mode=WorkMode.SR_CLOSE), mode=WorkMode.SR_CLOSE) as on:
        await on.axis.move_to(2.0)
        await on.axis.set_current(1200)
        await getattr(on.axis, verb)()
        assert on.sim.restarts == 1
        assert await on.axis.motor_status() is Status.STOPPED
        with pytest.raises(ReferenceLost, match="was restarted"):
            await on.axis.move_to(3.0)
        assert on.shaft == pytest.approx(2.0)
        await on.axis.enable()
        await on.axis.set_zero()
        await on.axis.move_to(1.0, rpm=1500)
        assert on.shaft == pytest.approx(3.0)
        # After a factory reset the mode is not the one that the facade goes by: it writes that again.
        assert on.sim.settings[r.WORK_MODE.address] is WorkMode.SR_CLOSE
        assert on.axis.acknowledged.current == (None if verb == "factory_reset" else 1200)


@pytest.mark.parametrize("verb", ["restart", "calibrate", "factory_reset", "silence", "enter_boot"])
@on_virtual_clock
async def test_a_turning_motor_is_not_restarted(verb: str) -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(120)
        with pytest.raises(NotStanding, match=r"stop\(\) it first"):
            await getattr(on.axis, verb)()
        assert on.sim.moving(on.bus.now())
        assert on.sim.restarts == 0


@on_virtual_clock
async def test_a_restart_whose_answer_is_lost_is_not_repeated() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        sim.lose_reply(r.RESTART)
        with pytest.raises(OutcomeUnknown):
            await on.axis.restart()
        await anyio.sleep(3)
        assert sim.restarts == 1
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_drive_that_does_not_come_back_says_what_its_screen_may_show() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        sim._commands[r.RESTART.address] = lambda _, now: sim.switch_off(now)
        with pytest.raises(MotionError, match=r"within 5 s of its restart.*Low Voltage Error!"):
            await on.axis.restart(timeout=5.0)


@on_virtual_clock
async def test_a_drive_that_answers_once_more_before_it_restarts_is_not_taken_for_restarted() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        sim._commands[r.RESTART.address] = lambda _, now: sim.motion.later(1.2, now, sim._start_anew)
        await on.axis.restart()
        assert sim.restarts == 1
        await on.axis.enable()
        await on.axis.version()


@on_virtual_clock
async def test_a_calibration_is_waited_for_however_long_it_takes() -> None:
    async with bench(FlakyMks()) as on:
        begun = on.bus.now()
        await on.axis.calibrate()
        assert 3.6 < on.bus.now() - begun < 10
        await on.axis.version()


@pytest.mark.parametrize(
    ("after", "reply_is_lost"),
    [(0.015, False), (0.02, False), (0.1, False), (1.0, False), (2.5, False), (0.015, True), (0.1, True)],
)
@on_virtual_clock
async def test_a_calibration_is_stopped_where_its_bus_is_left(after: float, reply_is_lost: bool) -> None:
    """The motor turns by itself meanwhile: also where nobody knows whether it was heard."""
    sim = FlakyMks()
    with pytest.raises(RuntimeError, match="left"):
        async with bench(sim) as on:
            if reply_is_lost:
                sim.lose_reply(r.CALIBRATE)
            on.axis.calibrate()
            await anyio.sleep(after)
            raise RuntimeError("left")
    assert sim.status(on.bus.now()) is Status.STOPPED
    assert sim.restarts == 0


@on_virtual_clock
async def test_a_silent_drive_takes_no_commands_until_it_is_woken() -> None:
    async with bench(FlakyMks(1), FlakyMks(2)) as on:
        await on.axis.move_to(1.0)
        await on.axis.silence()
        with pytest.raises(MotionError, match=r"wake\(\) it first"):
            on.axis.move_to(2.0)
        await on.axes[1].move_to(2.0)
        await anyio.sleep(60)
        await on.axis.wake()
        await on.axis.move_to(2.0)
        assert on.shaft == pytest.approx(2.0)


@on_virtual_clock
async def test_a_drive_that_somebody_else_silenced_is_woken_though_it_counts_as_offline() -> None:
    async with bench(FlakyMks(), enable=False) as on:
        on.sim._silent = True
        for _ in range(4):
            with pytest.raises(Exception, match=r"No reply|stopped answering"):
                await on.axis.version()
        await on.axis.wake()
        await on.axis.version()


@on_virtual_clock
async def test_a_drive_in_boot_mode_moves_only_after_it_was_enabled_again() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.enter_boot()
        with pytest.raises(RearmRequired, match="boot mode"):
            await on.axis.move_to(1.0)
        on.sim.switch_on(on.bus.now())
        await anyio.sleep(10)
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)
        await on.axis.set_zero()
        await on.axis.move_to(1.0)


# Power-on run


@on_virtual_clock
async def test_a_power_on_run_is_set_on_a_standing_motor_only() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(120)
        with pytest.raises(NotStanding):
            await on.axis.set_power_on_run(True)
        assert not on.sent(r.POWER_ON_RUN)
        await on.axis.stop()
        await on.axis.set_power_on_run(True)
        await on.axis.restart()
        await anyio.sleep(1)
        assert on.sim.motion.motor.rpm(on.bus.now()) == pytest.approx(120)
        await on.axis.stop()
        await on.axis.set_power_on_run(False)
        await on.axis.restart()
        await anyio.sleep(1)
        assert not on.sim.moving(on.bus.now())


@on_virtual_clock
async def test_a_power_on_run_is_set_while_it_turns_where_that_is_asked_for() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(120)
        await on.axis.set_power_on_run(True, while_running=True)
        await anyio.sleep(1)
        assert not on.sim.moving(on.bus.now())  # 8.5: it slows down and stops
        await on.axis.move_by(1.0)


@on_virtual_clock
async def test_an_axis_that_runs_by_itself_is_stopped_before_it_moves_or_homes() -> None:
    sim = FlakyMks()
    sim.settings[r.POWER_ON_RUN.address] = (1, 0, 60)
    async with bench(sim, enable=False) as on:
        sim.restart(on.bus.now())
        await anyio.sleep(1)
        assert sim.moving(on.bus.now())
        on.axis.enable()
        await on.axis.move_to(1.0)
        assert await on.axis.position() == pytest.approx(1.0, abs=1e-3)
        sim.restart(on.bus.now())
        await anyio.sleep(1)
        before = len(on.records)
        await on.axis.home()
        written = [record.request for record in on.records[before:] if record.request[1] != 4]
        assert written[0][3] in (r.MOVE_TO_COUNTS.address, r.EMERGENCY_STOP.address)  # a stop
        assert written[-1][3] == r.GO_HOME.address
