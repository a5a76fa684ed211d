"""The examples of parts 5 to 9, said in the library's own verbs: the printed frames go out, and the shaft obeys."""

import anyio
import pytest

from rs485bus.devices.mks import (
    Inputs,
    Level,
    MksServo,
    Model,
    MotionDirection,
    ParameterDirection,
    SingleTurnHoming,
    StopHoming,
    SwitchHoming,
    WorkMode,
)
from rs485bus.devices.mks import registers as r
from rs485bus.errors import LimitReached, MoveFailed
from rs485bus.sim import Machine, SimMks
from tests.devices.mks.bench import Bench, bench, on_virtual_clock
from tests.devices.mks.manual import SAYS, VECTORS

SLOW = 20_000 / 254
"""The acceleration of code 2, in rpm/s."""
FAST = 20_000 / 16
"""That of code 240."""


def plant(**options: object) -> SimMks:
    machine = Machine(home_switch=-2.0, right_switch=20.0, travel=(-5.0, 10_000.0))
    return SimMks(machine=machine, mode=WorkMode.CR_VFOC, **options)  # type: ignore[arg-type] # each test names its own


def went_out(on: Bench, section: str, *, but: tuple[int, ...] = ()) -> None:
    """All requests of an example went out, in its order; save those about registers given."""
    printed = [
        bytes.fromhex(vector["hex"])
        for vector in VECTORS
        if vector["section"] == section and vector["source"] == "step" and vector["direction"] == "request"
    ]
    wanted = [frame for frame in printed if int.from_bytes(frame[2:4], "big") not in but]
    sent = iter([record.request for record in on.records])
    for frame in wanted:
        assert frame in sent, f"{frame.hex(' ')}: {SAYS[frame.hex(' ').upper()]}"


@on_virtual_clock
async def test_5_4_homing_by_the_origin_switch() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.home(SwitchHoming(direction=ParameterDirection.CW, rpm=100, trigger=Level.LOW))
        assert on.shaft == pytest.approx(-2.0)
        assert await on.axis.position() == 0.0
        went_out(on, "5.4", but=(0x94,))  # its homing current has no meaning for a switch
        assert on.sent(r.HOMING_TORQUE)[0][7:13] == bytes.fromhex("00 00 20 00 00 00")


@on_virtual_clock
async def test_5_5_homing_against_the_mechanical_stop() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.home(StopHoming(direction=ParameterDirection.CW, rpm=100, current=600, offset_turns=0.5))
        assert on.shaft == pytest.approx(-4.5)
        went_out(on, "5.5")


@on_virtual_clock
async def test_5_6_homing_to_the_zero_of_the_turn_at_power_on() -> None:
    async with bench(plant(shaft=0.4), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.set_homing(SingleTurnHoming(speed=2, set_zero_here=True))
        went_out(on, "5.6", but=(0x94,))
        on.sim.switch_off(on.bus.now())
        on.sim.turn_shaft(-0.3, on.bus.now())
        on.sim.switch_on(on.bus.now())
        await anyio.sleep(3)
        assert on.shaft == pytest.approx(0.4)


@on_virtual_clock
async def test_5_7_back_to_the_coordinate_zero() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.home(SwitchHoming(rpm=100))
        await on.axis.move_to(5.0)
        await on.axis.return_to_zero()
        assert on.shaft == pytest.approx(-2.0)
        went_out(on, "5.7")


@pytest.mark.parametrize("section", ["6.3", "6.4"])
@on_virtual_clock
async def test_6_a_limit_switch_ends_a_move(section: str) -> None:
    async with bench(plant(model=Model.SERVO57D), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.set_limit_remap(False)
        await on.axis.home(SwitchHoming(rpm=100, end_limits=True))
        went_out(on, "6.2", but=(0x94,))
        left = section == "6.3"
        move = on.axis.move_by_pulses(-0x100_0000 if left else 0x100_0000, rpm=300, acceleration=FAST)
        with pytest.raises(LimitReached):
            await move  # told when it stands, not when it should be there
        await on.axis.stop()
        went_out(on, section)
        assert on.shaft == pytest.approx(-2.0 if left else 20.0)
        # At trigger level low the port of a closed switch is low.
        assert ((Inputs.IN_1 if left else Inputs.IN_2) in await on.axis.inputs()) is False


@on_virtual_clock
async def test_6_a_move_that_a_limit_switch_ended_says_so() -> None:
    async with bench(plant(model=Model.SERVO57D), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.home(SwitchHoming(rpm=100, end_limits=True))
        with pytest.raises(MoveFailed, match="limit switch"):
            await on.axis.move_to(30.0)
        assert await on.axis.position() == pytest.approx(22.0, abs=1e-3)
        assert await on.axis.move_to(21.0) == pytest.approx(21.0, abs=1e-3)


@on_virtual_clock
async def test_8_4_speed_mode_and_its_stop() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.run(300, acceleration=SLOW)
        assert await on.axis.velocity() == pytest.approx(300, abs=9)
        await on.axis.stop()
        assert await on.axis.velocity() == 0
        went_out(on, "8.4")


@on_virtual_clock
async def test_8_5_running_at_power_on() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.run(300, acceleration=SLOW)
        await on.axis.set_power_on_run(True, while_running=True)
        await anyio.sleep(5)
        assert await on.axis.velocity() == 0
        on.sim.restart(on.bus.now())
        await anyio.sleep(10)
        assert await on.axis.velocity() == 300
        await on.axis.stop()
        await on.axis.set_power_on_run(False)
        went_out(on, "8.5")


@on_virtual_clock
async def test_9_1_3_a_hundred_turns_by_pulses_and_the_stops() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.move_by_pulses(320_000, rpm=300, acceleration=SLOW)
        assert on.shaft == pytest.approx(100.0)
        await on.axis.stop()
        await on.axis.emergency_stop()
        went_out(on, "9.1.3")


@on_virtual_clock
async def test_9_2_3_to_a_pulse_count() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.set_zero()
        await on.axis.move_to_pulses(320_000, rpm=300, acceleration=SLOW)
        assert on.shaft == pytest.approx(100.0)
        await on.axis.stop()
        await on.axis.emergency_stop()
        assert await on.axis.pulses() == 320_000
        went_out(on, "9.2.3")


@on_virtual_clock
async def test_9_3_3_ten_turns_by_counts() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.move_by_counts(163_840, rpm=300, acceleration=SLOW)
        assert on.shaft == pytest.approx(10.0)
        assert await on.axis.counts() == 163_840
        await on.axis.stop()
        await on.axis.emergency_stop()
        went_out(on, "9.3.3")


@pytest.mark.parametrize("error", [-1, 0, 1])
@on_virtual_clock
async def test_9_4_3_to_ten_turns(error: int) -> None:
    sim = plant()
    sim.motion.machine.following_error = error  # 9.4.3 logs one count less
    async with bench(sim, enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.set_zero()
        await on.axis.move_to(10.0, rpm=300, acceleration=SLOW)
        await on.axis.stop()
        await on.axis.emergency_stop()
        assert await on.axis.counts() == 163_840 + error
        assert await on.axis.angle_error() == pytest.approx(error * 360 / 16384, abs=0.01)
        went_out(on, "9.4.3")


@on_virtual_clock
async def test_9_4_4_another_target_while_it_runs() -> None:
    async with bench(plant(), enable=False) as on:
        await on.axis.set_mode(WorkMode.SR_VFOC)
        await on.axis.set_zero()
        move = on.axis.move_to(151_683_072 / 16384, rpm=300, acceleration=SLOW)
        await anyio.sleep(20.0)
        assert on.shaft > 90
        await on.axis.retarget(10.0, rpm=600, acceleration=SLOW)
        await move
        assert await on.axis.counts() == 163_840
        await on.axis.stop()
        await on.axis.emergency_stop()
        went_out(on, "9.4.4")


def test_the_directions_of_moves_and_of_parameters_are_each_other_s_opposite() -> None:
    assert MotionDirection.CW.value == ParameterDirection.CCW.value == 1
    assert MksServo.counts_per_turn == 16384
