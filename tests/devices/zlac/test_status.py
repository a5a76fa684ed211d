"""What a drive reports, and its parameters."""

import asyncio

import pytest

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.telemetry import StatusWord
from rs485bus.devices.zlac.values import Brake, Fault, Inputs, Outputs, ShaftState, Side
from rs485bus.errors import LimitExceeded, NotSupported
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant


def test_a_status_word_is_read_both_ways() -> None:
    word = StatusWord(0xC041)
    assert (word.low.shaft, word.low.running) == (ShaftState.LOCKED, True)
    assert (word.high.shaft, word.high.running) == (ShaftState.ALARM, False)
    assert word.of(Side.LEFT, "low") == word.of(Side.RIGHT, "high") == word.low
    assert word.of(Side.RIGHT, "low") == word.of(Side.LEFT, "high") == word.high
    assert word.running
    assert word.either(ShaftState.ALARM)
    assert not word.enabled


@pytest.mark.parametrize("word", [0x4000, 0x0040, 0x4080, 0xC040, 0x0000])
def test_a_drive_is_enabled_only_if_both_halves_say_so(word: int) -> None:
    assert StatusWord(0x4040).enabled
    assert not StatusWord(word).enabled


@on_virtual_clock
async def test_everything_a_drive_reports_has_its_unit() -> None:
    async with plant(reverse=(False, True), units_per_turn=2.0) as p:
        await p.base.run(60, 30)
        await p.base.left.run(60)
        p.sim.left.temperature, p.sim.right.temperature, p.sim.temperature = 45, -7, 38.5
        p.sim.left.hall, p.sim.right.hall, p.sim.bus_voltage = 5, 7, 25.37
        status = await p.base.status()
        left, right = status.left, status.right
        assert (left.rpm, right.rpm) == pytest.approx((60, 30), abs=2)
        assert left.position == pytest.approx(2 * p.shafts()[0], abs=0.1)
        assert right.position == pytest.approx(-2 * p.shafts()[1], abs=0.1)
        assert (left.torque, right.torque) == (300, 300)
        assert (left.temperature, right.temperature, status.temperature) == (45, -7, 38.5)
        assert (left.hall, right.hall, status.bus_voltage) == (5, 7, 25.37)
        assert (left.shaft, left.running) == (ShaftState.LOCKED, True)
        assert status.enabled
        assert status.faults is Fault(0)


@on_virtual_clock
async def test_the_errors_of_both_motors_are_combined_and_named() -> None:
    async with plant() as p:
        p.sim.fail(Side.LEFT, Fault.OVER_VOLTAGE | Fault.HALL, p.now)
        p.sim.fail(Side.RIGHT, Fault.ENCODER, p.now)
        status = await p.base.status()
        assert status.left.faults == Fault.OVER_VOLTAGE | Fault.HALL
        assert status.faults == Fault.OVER_VOLTAGE | Fault.HALL | Fault.ENCODER
        assert "Hall sensor (check the sensor cable" in status.faults.describe()
        assert status.left.shaft is status.right.shaft is ShaftState.ALARM
        assert status.outputs is Outputs.Y0


@pytest.mark.parametrize("left", ["low", "high"])
@on_virtual_clock
async def test_which_half_is_left_is_an_option_of_what_is_told(left: str) -> None:
    async with plant(WatchedZlac(status_word_left=left), status_word_left=left) as p:
        await p.base.left.run(50)
        status = await p.base.status()
        assert (status.left.running, status.right.running) == (True, False)
    async with plant(WatchedZlac(status_word_left=left)) as p:
        await p.base.left.run(50)
        status = await p.base.status()
        assert status.left.running == (left == "low")
        assert status.word.running


@on_virtual_clock
async def test_inputs_brakes_and_the_emergency_stop_input_are_told() -> None:
    async with plant() as p:
        await p.base.set_brakes(Brake.OPEN, Brake.CLOSED)
        p.sim.press(Inputs.X0, p.now)
        status = await p.base.status()
        assert (status.left.brake, status.right.brake) == (Brake.OPEN, Brake.CLOSED)
        assert status.inputs is Inputs.X0
        assert status.emergency_stop_input
        p.sim.set(r.INPUTS_REVERSED, Inputs.X0)
        assert (await p.base.status()).emergency_stop_input
        assert (await p.base.status()).inputs is Inputs(0)
        p.sim.press(Inputs.X1, p.now)
        assert not (await p.base.status()).emergency_stop_input


@on_virtual_clock
async def test_positions_speeds_and_torques_of_both_wheels_are_one_request() -> None:
    async with plant() as p:
        await p.base.run(60, -60)
        await asyncio.sleep(0.01)
        begun = len(p.sim.asked)
        seen = await p.base.snapshot()
        assert len(p.sim.asked) == begun + 1
        left, right = seen.motion
        assert left.position == pytest.approx(-right.position, abs=2)
        assert seen.at <= p.now


@on_virtual_clock
async def test_who_asks_at_the_same_time_is_told_the_same() -> None:
    async with plant() as p:
        await asyncio.sleep(0.01)
        begun = len(p.sim.asked)
        await asyncio.gather(*(p.base.left.position() for _ in range(5)), *(p.base.snapshot() for _ in range(5)))
        assert len(p.sim.asked) == begun + 1


@on_virtual_clock
async def test_a_lost_answer_does_not_hold_up_the_next_question() -> None:
    async with plant() as p:
        await asyncio.sleep(0.01)  # or it would be told what was seen when the drive was set up
        p.sim.lose_reply("0320A2000D")
        await p.base.snapshot()
        began = p.now
        await asyncio.sleep(0.01)
        await p.base.snapshot()
        assert p.now - began < 0.05


@on_virtual_clock
async def test_nobody_is_told_what_was_asked_before_his_own_command() -> None:
    async with plant() as p:
        # An answer is late by a lost one; meanwhile the left wheel is set in motion.
        p.sim.lose_reply("0320A2000D")
        early = asyncio.ensure_future(p.base.snapshot())
        await asyncio.sleep(0.001)
        await p.bus.unit(1).write_register(r.CAN_NODE_ID.address, 2)
        changed = p.now
        late = await p.base.snapshot()
        assert (await early).at < changed <= late.at


@on_virtual_clock
async def test_axes_say_whether_they_are_idle() -> None:
    async with plant() as p:
        assert await p.base.left.idle()
        p.base.left.move_to(1.0)
        assert not await p.base.left.idle()
        assert await p.base.right.idle()
        await p.base.drain()
        assert await p.base.left.idle()


@on_virtual_clock
async def test_all_parameters_of_a_motor_are_read_by_name() -> None:
    async with plant() as p:
        p.sim.set(r.RATED_CURRENT.right, 7.5)
        left, right = await p.base.parameters(Side.LEFT), await p.base.parameters(Side.RIGHT)
        assert len(left) == len(right) == len(r.PARAMETERS) == 25
        assert left["left rated current"] == 15.0
        assert right["right rated current"] == 7.5
        assert right["right position loop Kf"] == 1000


@on_virtual_clock
async def test_a_parameter_is_set_and_kept_only_if_it_is_to_be() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.set_parameter(r.VELOCITY_KP.left, 700)
        await p.base.set_parameter(r.VELOCITY_KP.right, 800, save=True)
        await p.base.set_parameter(r.DRIVE_TEMPERATURE_LIMIT, 75.5, save=True)
        assert await p.base.parameter(r.VELOCITY_KP.left) == 700
        assert await p.base.parameter(r.SAVE_WRITES) is False
        p.sim.power_cycle(p.now)
        await asyncio.sleep(1.5)
        assert await p.base.parameter(r.VELOCITY_KP.left) == 500
        assert await p.base.parameter(r.VELOCITY_KP.right) == 800
        assert await p.base.parameter(r.DRIVE_TEMPERATURE_LIMIT) == 75.5


@on_virtual_clock
async def test_the_eeprom_is_not_left_open_when_a_parameter_is_refused() -> None:
    async with plant() as p:
        p.sim.refuse("06203C")
        with pytest.raises(Exception, match="Refused"):
            await p.base.set_parameter(r.VELOCITY_KP.left, 700, save=True)
        assert await p.base.parameter(r.SAVE_WRITES) is False


@on_virtual_clock
async def test_what_is_no_parameter_is_not_set() -> None:
    async with plant() as p:
        for register in (r.WATCHDOG, r.NODE_ID, r.TARGET_VELOCITY.left, r.TARGET_POSITION.right, r.VERSION):
            with pytest.raises(NotSupported, match=r"bus\.unit"):
                p.base.set_parameter(register, 1)
        with pytest.raises(NotSupported):
            p.base.set_parameter(r.RESTORE, True)
        with pytest.raises(LimitExceeded):
            p.base.set_parameter(r.VELOCITY_KP.left, 30_001)
