"""Settings are typed, checked before anything is sent, and known only by what the drive acknowledged."""

from collections.abc import Callable
from dataclasses import fields
from decimal import Decimal
from fractions import Fraction
from typing import Any, cast

import anyio
import pytest

from rs485bus.bus.handle import Handle
from rs485bus.devices.mks import (
    CLOSE_GAINS,
    SETTINGS,
    VFOC_GAINS,
    Cost,
    EnableLevel,
    Gains,
    HoldingCurrent,
    Level,
    MksProfile,
    MksServo,
    Model,
    OutputMask,
    ParameterDirection,
    PositionProtection,
    PulseDivider,
    SingleTurnHoming,
    StopHoming,
    SwitchHoming,
    WorkMode,
)
from rs485bus.devices.mks import registers as r
from rs485bus.errors import (
    DeviceRefused,
    LimitExceeded,
    MotionError,
    MoveCancelled,
    NoReply,
    NotSent,
    NotStanding,
    NotSupported,
)
from rs485bus.wire.registers import Block, Register
from tests.devices.mks.bench import FlakyMks, bench, on_virtual_clock

FULL = MksProfile(
    mode=WorkMode.SR_CLOSE,
    current=2400,
    holding_current=HoldingCurrent.PERCENT_30,
    microsteps=32,
    enable_level=EnableLevel.ALWAYS,
    pulse_direction=ParameterDirection.CCW,
    screen_off=True,
    interpolation=False,
    key_lock=True,
    vfoc_gains=Gains(1, 2, 3, 4),
    close_gains=Gains(5, 6, 7, 1024),
    overcurrent_protection=True,
    position_protection=PositionProtection(turns=0.5, seconds=1.5),
    pulse_divider=PulseDivider(period=3200, start=Level.HIGH),
    limit_remap=True,
    homing=StopHoming(rpm=120, current=700),
)
KEPT: dict[Register[Any] | Block, Any] = {
    r.WORK_MODE: WorkMode.SR_CLOSE,
    r.CURRENT: 2400,
    r.HOLDING_CURRENT: HoldingCurrent.PERCENT_30,
    r.MICROSTEPS: 32,
    r.ENABLE_LEVEL: EnableLevel.ALWAYS,
    r.PULSE_DIRECTION: ParameterDirection.CCW,
    r.SCREEN_OFF: True,
    r.INTERPOLATION: False,
    r.KEY_LOCK: True,
    r.PID_VFOC: (1, 2, 3, 4),
    r.PID_CLOSE: (5, 6, 7, 1024),
    r.STALL_PROTECTION: True,
    r.POSITION_PROTECTION: (0, True, 1.5, 0.5),
    r.PULSE_DIVIDER: (Level.HIGH, 3200),
    r.LIMIT_REMAP: True,
    r.HOMING: (Level.LOW, ParameterDirection.CW, 120, False),
}


def test_each_field_of_a_profile_is_a_setting_and_the_other_way_round() -> None:
    assert [field.name for field in fields(MksProfile)] == list(SETTINGS)
    assert all(Cost.KEPT in setting.cost and setting.section for setting in SETTINGS.values())
    assert FULL.values().keys() == SETTINGS.keys()


@on_virtual_clock
async def test_a_profile_is_written_and_known_by_what_the_drive_acknowledged() -> None:
    async with bench(FlakyMks(model=Model.SERVO57D), enable=False) as on:
        assert FULL.differences(on.axis.acknowledged) == {name: (value, None) for name, value in FULL.values().items()}
        assert await on.axis.write_profile(FULL) == FULL
        assert FULL.differences(on.axis.acknowledged) == {}
        assert {what: on.sim.settings[what.address] for what in KEPT} == KEPT
        other = MksProfile(current=2500, microsteps=32)
        assert other.differences(on.axis.acknowledged) == {"current": (2500, 2400)}


@on_virtual_clock
async def test_settings_survive_a_power_cycle() -> None:
    async with bench(FlakyMks(model=Model.SERVO57D), enable=False) as on:
        await on.axis.write_profile(FULL)
        await on.axis.restart()
        assert {what: on.sim.settings[what.address] for what in KEPT} == KEPT
        assert on.axis.acknowledged == FULL


@on_virtual_clock
async def test_each_setter_writes_what_the_profile_writes() -> None:
    async with bench(FlakyMks(model=Model.SERVO57D), enable=False) as on:
        for name, value in FULL.values().items():
            await getattr(on.axis, f"set_{name}")(value)
        assert on.axis.acknowledged == FULL
        assert {what: on.sim.settings[what.address] for what in KEPT} == KEPT


@on_virtual_clock
async def test_a_profile_ends_with_the_first_setting_that_is_refused_and_tells_what_is_missing() -> None:
    async with bench(FlakyMks(model=Model.SERVO42D)) as on:
        on.axis.model = Model.SERVO57D  # wrongly
        with pytest.raises(DeviceRefused):
            await on.axis.write_profile(
                MksProfile(holding_current=HoldingCurrent.PERCENT_10, current=5000, key_lock=True)
            )
        assert on.axis.acknowledged == MksProfile()
        with pytest.raises(DeviceRefused):
            await on.axis.write_profile(
                MksProfile(current=900, pulse_divider=PulseDivider(period=100), limit_remap=True)
            )
        assert on.axis.acknowledged == MksProfile(current=900)


@on_virtual_clock
async def test_nothing_of_a_profile_is_written_if_a_value_is_out_of_its_range() -> None:
    async with bench(FlakyMks()) as on:
        sent = len(on.records)
        with pytest.raises(LimitExceeded, match=r"3500 mA is outside 0\.\.3000 mA"):
            on.axis.write_profile(MksProfile(mode=WorkMode.SR_VFOC, current=3500))
        with pytest.raises(NotSupported, match="only the 57D"):
            on.axis.write_profile(MksProfile(key_lock=True, pulse_divider=PulseDivider(period=100)))
        assert len(on.records) == sent


@on_virtual_clock
async def test_a_current_that_is_not_saved_is_gone_after_a_restart() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_current(2000)
        await on.axis.set_current(800, save=False)
        assert on.sim.motion.current == 800
        assert on.axis.acknowledged.current == 2000
        await on.axis.restart()
        assert on.sim.motion.current == 2000


OUT_OF_RANGE: list[tuple[Callable[[MksServo], Handle[None]], str]] = [
    (lambda x: x.set_current(-1), r"-1 mA is outside 0\.\.3000 mA of a SERVO42D"),
    (lambda x: x.set_current(3001), r"3001 mA is outside 0\.\.3000 mA of a SERVO42D"),
    (lambda x: x.set_current(5000, save=False), r"5000 mA is outside 0\.\.3000 mA of a SERVO42D"),
    (lambda x: x.set_microsteps(0), r"microsteps 0 is outside 1\.\.255"),
    (lambda x: x.set_microsteps(256), r"microsteps 256 is outside 1\.\.255"),
    (lambda x: x.set_vfoc_gains(Gains(1025, 0, 0, 0)), r"Kp 1025 is outside 0\.\.1024"),
    (lambda x: x.set_close_gains(Gains(0, 0, 0, -1)), r"Kv -1 is outside 0\.\.1024"),
    (
        lambda x: x.set_position_protection(PositionProtection(turns=2.4, seconds=1)),
        r"position error 2.4 turns is outside 0\.\.2.34",
    ),
    (
        lambda x: x.set_position_protection(PositionProtection(turns=1, seconds=984)),
        r"984 s is outside 0\.\.983.025 s",
    ),
    (lambda x: x.set_heartbeat(-0.001), r"heartbeat time -0.001 s is outside 0\.001\.\.4294967\.295 s; 0 is off"),
    (lambda x: x.set_heartbeat(4294967.296), r"is outside 0\.001\.\.4294967\.295 s"),
    (lambda x: x.set_heartbeat(0.0004), r"0\.0004 s is outside 0\.001\.\."),  # it would turn it off
    (lambda x: x.set_heartbeat(float("nan")), "must be a number, not nan"),
    (lambda x: x.set_mode(6), r"work mode 6 is none of CR_OPEN \(0\), .*SR_VFOC \(5\)"),  # type: ignore[arg-type] # wrongly
    (lambda x: x.set_holding_current(9), r"none of PERCENT_10 \(0\), .*PERCENT_90 \(8\)"),  # type: ignore[arg-type] # wrongly
    (lambda x: x.set_key_lock(2), r"key lock 2 is outside 0\.\.1"),  # type: ignore[arg-type] # wrongly
]


@pytest.mark.parametrize("case", range(len(OUT_OF_RANGE)))
@on_virtual_clock
async def test_a_value_out_of_range_never_reaches_the_wire_and_the_message_names_the_range(case: int) -> None:
    verb, said = OUT_OF_RANGE[case]
    async with bench(FlakyMks(), enable=False) as on:
        with pytest.raises(LimitExceeded, match=said):
            verb(on.axis)
        await on.axis.drain()
        assert not on.records


# What settings cost


@pytest.mark.parametrize("name", [name for name, setting in SETTINGS.items() if Cost.STANDING in setting.cost])
@on_virtual_clock
async def test_what_needs_a_standing_motor_is_not_sent_to_a_turning_one(name: str) -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(120)
        sent = len([record for record in on.records if record.request[1] != 4])
        with pytest.raises(NotStanding, match=r"stop\(\) it first"):
            await getattr(on.axis, f"set_{name}")(getattr(FULL, name))
        assert len([record for record in on.records if record.request[1] != 4]) == sent
        assert on.sim.moving(on.bus.now())
        await on.axis.stop()
        await getattr(on.axis, f"set_{name}")(getattr(FULL, name))


@pytest.mark.parametrize("name", [name for name, setting in SETTINGS.items() if Cost.STANDING not in setting.cost])
@on_virtual_clock
async def test_the_others_can_be_changed_while_it_turns(name: str) -> None:
    async with bench(FlakyMks(model=Model.SERVO57D)) as on:
        await on.axis.run(120)
        await getattr(on.axis, f"set_{name}")(getattr(FULL, name))
        assert on.sim.moving(on.bus.now())


@on_virtual_clock
async def test_a_shaft_that_shifts_a_little_with_a_setting_has_not_lost_its_reference() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.move_to(1.0)
        on.axis.set_microsteps(32)
        await on.axis.drain()
        on.sim.turn_shaft(0.005, on.bus.now())  # a full step: the motor is energised anew
        await anyio.sleep(1)
        assert await on.axis.move_to(2.0) == pytest.approx(2.0, abs=1e-3)


@on_virtual_clock
async def test_a_setting_whose_answer_is_lost_is_written_again() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        sim.lose_reply(r.CURRENT)
        await on.axis.set_current(1000)
        assert len(on.sent(r.CURRENT)) == 2
        assert on.axis.acknowledged.current == 1000


@on_virtual_clock
async def test_microsteps_of_which_nobody_knows_are_written_again_before_the_next_move() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        sim.lose_reply(r.MICROSTEPS, times=3)
        with pytest.raises(NoReply):
            await on.axis.set_microsteps(128)
        assert sim.settings[r.MICROSTEPS.address] == 128  # it took them, and nobody was told
        await on.axis.run(120)
        assert sim.settings[r.MICROSTEPS.address] == 16
        assert on.sim.motion.motor.rpm(on.bus.now()) == pytest.approx(120)


@on_virtual_clock
async def test_a_refused_mode_leaves_the_old_one() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        sim._commands[r.WORK_MODE.address] = sim._commands[r.MICROSTEPS.address] = _refuse
        with pytest.raises(DeviceRefused):
            await on.axis.set_mode(WorkMode.SR_OPEN)
        with pytest.raises(DeviceRefused):
            await on.axis.set_microsteps(8)
        assert on.axis.mode is WorkMode.SR_VFOC
        await on.axis.move_to(1.0, rpm=3000)
        assert len(on.sent(r.WORK_MODE)) == 1


def _refuse(value: object, now: float) -> None:
    from rs485bus.sim.mks_memory import Refused

    raise Refused


# What no watchdog outlives


AWAY: list[Callable[[MksServo], Handle[None]]] = [
    lambda x: x.calibrate(),
    lambda x: x.restart(),
    lambda x: x.factory_reset(),
    lambda x: x.silence(),
    lambda x: x.enter_boot(),
    lambda x: x.set_homing(SingleTurnHoming()),
]


@pytest.mark.parametrize("timeout", [1.0, 600.0])
@pytest.mark.parametrize("verb", range(len(AWAY)))
@on_virtual_clock
async def test_what_takes_a_drive_away_is_refused_while_any_watchdog_is_armed(verb: int, timeout: float) -> None:
    async with bench(FlakyMks(1), FlakyMks(2)) as on:
        guarded, other = on.axes
        async with on.bus.watchdog(guarded, timeout=timeout):
            for axis in (guarded, other):
                with pytest.raises(NotSent, match=r"watchdog on this bus is armed.*Leave the watchdog block first"):
                    await AWAY[verb](axis)
            await guarded.set_homing(SwitchHoming())  # this one is quick
            # A raw write of it is refused, too.
            with pytest.raises(NotSent, match="watchdog on this bus is armed"):
                await on.bus.unit(2).write_register(r.RESTART.address, 1)
            with pytest.raises(NotSent, match="watchdog on this bus is armed"):
                await on.bus.broadcast.write_register(r.RESTART.address, 1)
        assert [sim.restarts for sim in on.sims] == [0, 0]
        assert not on.sims[0].trips
        await guarded.move_to(1.0)  # the reference was not lost by what was not done
        await other.restart()
        assert on.sims[1].restarts == 1


@on_virtual_clock
async def test_the_heartbeat_time_of_a_guarded_axis_is_left_to_its_watchdog() -> None:
    async with bench(FlakyMks()) as on:
        async with on.axis.watchdog(1.0):
            with pytest.raises(MotionError, match="watchdog block"):
                await on.axis.set_heartbeat(0.0)
            assert on.sim.watchdog_ms == 1000
        await on.axis.set_heartbeat(2.5)
        assert on.sim.watchdog_ms == 2500


# Outputs


@on_virtual_clock
async def test_outputs_are_a_57d_s() -> None:
    async with bench(FlakyMks(1), FlakyMks(2, model=Model.SERVO57D)) as on:
        small, large = on.axes
        with pytest.raises(NotSupported, match="SERVO42D has neither OUT_1 nor OUT_2"):
            small.set_outputs(out_1=True)
        with pytest.raises(NotSupported):
            small.set_pulse_divider(PulseDivider(period=100))
        await large.set_outputs(out_1=False, out_2=OutputMask.HOLD)
        assert on.sent(r.OUTPUTS) == [bytes.fromhex("02 10 00 36 00 02 04 02 00 01 00") + on.sent(r.OUTPUTS)[0][-2:]]
        assert "OUT_1" not in str(await large.inputs())


@pytest.mark.parametrize("microsteps", [Decimal(16), Fraction(16), 16.0])
@on_virtual_clock
async def test_microsteps_of_any_kind_of_number_leave_an_axis_that_runs_and_stops(microsteps: Any) -> None:
    orders: list[Callable[[MksServo], Handle[Any]]] = [
        lambda axis: axis.set_microsteps(cast(Any, microsteps)),
        lambda axis: axis.write_profile(MksProfile(microsteps=cast(Any, microsteps))),
    ]
    for order in orders:
        async with bench(FlakyMks()) as on:
            await order(on.axis)
            assert type(on.axis.microsteps) is int
            assert on.axis.acknowledged == MksProfile(microsteps=16)
            await on.axis.run(60)
            with anyio.fail_after(5):
                await on.axis.stop()
            assert await on.axis.idle()


@pytest.mark.parametrize("name", ["vfoc_gains", "close_gains", "position_protection", "pulse_divider"])
@on_virtual_clock
async def test_a_setting_of_several_numbers_that_is_given_one_says_how_it_is_made(name: str) -> None:
    async with bench(FlakyMks(), enable=False) as on:
        large = MksServo(on.bus, 2, model=Model.SERVO57D)
        with pytest.raises(TypeError, match="must be made like"):
            getattr(large, f"set_{name}")(5)
        assert not on.records


@on_virtual_clock
async def test_a_failed_setting_cancels_what_is_queued_behind_it() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(60)
        failing, behind = on.axis.set_microsteps(32), on.axis.move_to(1.0)
        with pytest.raises(NotStanding):
            await failing
        with pytest.raises(MoveCancelled):
            await behind
        await on.bus_is_alive()


def test_the_gains_as_shipped_are_those_printed() -> None:
    assert (VFOC_GAINS.kp, VFOC_GAINS.ki, VFOC_GAINS.kd, VFOC_GAINS.kv) == (0xDC, 0x64, 0x10E, 0x140)
    assert (CLOSE_GAINS.kp, CLOSE_GAINS.ki, CLOSE_GAINS.kd, CLOSE_GAINS.kv) == (0xC8, 0x50, 0xFA, 0x12C)
