"""Questions that are refused while an axis moves: what was begun is never said to be nothing."""

from collections.abc import Callable

import pytest

from rs485bus.devices.mks import SwitchHoming
from rs485bus.devices.mks import registers as r
from rs485bus.errors import DeviceRefused, MotionError, MoveFailed
from rs485bus.motion.move import Move, MoveState
from rs485bus.sim.treatment import PLAIN, Treatment
from rs485bus.wire.registers import Register
from tests.devices.mks.bench import Bench, FlakyMks, bench, on_virtual_clock

HOMING = SwitchHoming(rpm=120)


def refuse(on: Bench, what: Register[int], code: int, times: float, since: Callable[[], bool] = lambda: True) -> None:
    """Answer the next questions of a kind, from some time on, by an exception."""
    left = times

    def script(frame: bytes, now: float) -> Treatment:
        nonlocal left
        if frame[1] == 4 and frame[2:4] == what.address.to_bytes(2, "big") and left > 0 and since():
            left -= 1
            return Treatment(code=code)
        return PLAIN

    on.line.pair.script = script


@pytest.mark.parametrize("code", [4, 5, 6])
@on_virtual_clock
async def test_one_refused_question_ends_no_homing(code: int) -> None:
    for what in (r.POSITION, r.STATUS, r.HOMED):
        async with bench(FlakyMks()) as on:
            homing: list[Move] = []
            refuse(on, what, code, 2, since=lambda: homing[0].state is MoveState.MOVING)  # noqa: B023 # this one's
            homing.append(on.axis.home(HOMING))
            await homing[0]
            assert await on.axis.move_to(1.0) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("code", [1, 4])
@on_virtual_clock
async def test_a_homing_whose_end_cannot_be_asked_for_is_no_refusal_of_the_homing(code: int) -> None:
    async with bench(FlakyMks()) as on:
        homing: list[Move] = []
        refuse(on, r.HOMED, code, float("inf"), since=lambda: bool(on.sent(r.GO_HOME)))
        homing.append(on.axis.home(HOMING))
        with pytest.raises(MotionError) as told:
            await homing[0]
        assert "Nothing was done" not in str(told.value)
        assert not on.sim.moving(on.bus.now())


@on_virtual_clock
async def test_a_return_to_zero_whose_position_cannot_be_asked_for_is_no_refusal_of_it() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_zero()
        await on.axis.move_to(1.0)
        refuse(on, r.ENABLED, 4, float("inf"), since=lambda: bool(on.sent(r.GO_HOME)))
        with pytest.raises(MoveFailed, match="was begun") as told:
            await on.axis.return_to_zero()
        assert "Nothing was done" not in str(told.value)
        assert not on.sim.moving(on.bus.now())


@on_virtual_clock
async def test_a_question_that_is_refused_for_good_is_told_to_who_asks() -> None:
    async with bench(FlakyMks()) as on:
        refuse(on, r.POSITION, 2, 9)
        with pytest.raises(DeviceRefused):
            await on.axis.position()
