"""A run for a time ends when that is over since it began, whenever the drive answered."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest

from rs485bus import BusConfig, Zlac8015d, open_bus
from rs485bus.errors import MoveFailed
from rs485bus.sim import SimZlac, VirtualLine
from tests.integration.support import virtual

TARGET = 0x2088


@dataclass
class _Deaf:
    """What becomes of the frames that tell a wheel a speed."""

    sim: SimZlac
    hears: Callable[[int], bool] = lambda count: True
    answers: Callable[[int], bool] = lambda count: True
    count: int = 0

    def __post_init__(self) -> None:
        receive = self.sim.receive

        def filtered(frame: bytes, at: float) -> bytes | None:
            told = frame[1] in (0x06, 0x10) and int.from_bytes(frame[2:4], "big") == TARGET
            if not told:
                return receive(frame, at)
            self.count += 1
            reply = receive(frame, at) if self.hears(self.count) else None
            return reply if self.answers(self.count) else None

        self.sim.receive = filtered  # type: ignore[method-assign]

    def turns(self) -> bool:
        at = asyncio.get_running_loop().time()
        self.sim.advance(at)
        return self.sim.left.motor.moving(at)


@asynccontextmanager
async def _wheel(reply_timeout: float = 0.1) -> AsyncIterator[tuple[Zlac8015d, SimZlac]]:
    sim = SimZlac(1, watchdog=0)
    async with open_bus(VirtualLine(sim, baudrate=115200), config=BusConfig(reply_timeout=reply_timeout)) as bus:
        base = Zlac8015d(bus, 1)
        await base.enable()
        yield base, sim


async def _turned_for(deaf: _Deaf) -> float:
    """Seconds for which the wheel turns, from the first time that it does, in steps of two milliseconds."""
    turned = 0
    while not turned or deaf.turns():
        await asyncio.sleep(0.002)
        turned += deaf.turns()
    return 0.002 * turned


@pytest.mark.parametrize("answered", [2, 3, 4])
def test_a_run_whose_start_is_answered_late_lasts_as_long_as_it_should(answered: int) -> None:
    @virtual
    async def check() -> None:
        async with _wheel() as (base, sim):
            deaf = _Deaf(sim, answers=lambda count: count >= answered)
            lasts = asyncio.ensure_future(_turned_for(deaf))
            await base.left.run(120, duration=0.6, acceleration=2000)
            assert await lasts == pytest.approx(0.66, abs=0.04)  # and its ramp

    check()


@pytest.mark.parametrize("heard", [2, 3, 4])
def test_a_run_of_which_only_a_later_start_is_heard_lasts_as_long_as_it_should(heard: int) -> None:
    @virtual
    async def check() -> None:
        async with _wheel() as (base, sim):
            deaf = _Deaf(sim, hears=lambda count: count >= heard, answers=lambda count: count >= heard)
            lasts = asyncio.ensure_future(_turned_for(deaf))
            await base.left.run(120, duration=0.6, acceleration=2000)
            assert await lasts == pytest.approx(0.66, abs=0.04)

    check()


@virtual
async def test_a_short_run_whose_start_is_not_answered_does_not_go_on_while_an_answer_is_waited_for() -> None:
    async with _wheel(reply_timeout=1.0) as (base, sim):
        deaf = _Deaf(sim, answers=lambda count: count > 12)
        lasts = asyncio.ensure_future(_turned_for(deaf))
        await base.left.run(120, duration=0.1, acceleration=2000)
        assert await lasts < 0.2
        assert not deaf.turns()


@virtual
async def test_both_wheels_of_a_run_for_a_time_end_together_though_its_start_was_answered_late() -> None:
    async with _wheel() as (base, sim):
        deaf = _Deaf(sim, answers=lambda count: count >= 4)
        lasts = asyncio.ensure_future(_turned_for(deaf))
        await base.run(120, -120, duration=0.6, acceleration=2000)
        assert await lasts == pytest.approx(0.66, abs=0.04)
        assert not sim.right.motor.moving(asyncio.get_running_loop().time())


@virtual
async def test_both_wheels_of_a_run_whose_start_is_not_answered_slow_down_together_by_their_ramp() -> None:
    async with _wheel(reply_timeout=1.0) as (base, sim):
        deaf = _Deaf(sim, answers=lambda count: count > 12)
        lasts = asyncio.ensure_future(_turned_for(deaf))
        left, right = await base.run(120, -120, duration=0.5, acceleration=500)
        assert await lasts == pytest.approx(0.74, abs=0.03)
        assert (left, right) == pytest.approx((1.0, -1.0), abs=0.02)


@pytest.mark.parametrize("how", ["for a time", "and stopped"])
def test_a_wheel_that_ran_and_was_stopped_keeps_nothing_from_its_other_one(how: str) -> None:
    @virtual
    async def check() -> None:
        async with _wheel() as (base, _):
            if how == "for a time":
                runs = base.left.run(120, duration=1.5), base.right.run(120, duration=1.5)
                await asyncio.gather(*runs)
            else:
                await base.left.run(120)
                await base.left.stop()
            await base.set_zero()
            left = base.left.move_to(3.0)
            await asyncio.sleep(0.3)
            await base.right.move_to(1.0)
            await left

    check()


@pytest.mark.parametrize("ramp_rpm", [None, 1000.0])
@pytest.mark.parametrize(("rpm", "duration"), [(200, 0.1), (200, 1.0), (-120, 0.3), (90, 0.6), (1, 0.01)])
def test_a_run_too_short_for_its_speed_goes_as_far_as_its_ramps_take_it(
    rpm: float, duration: float, ramp_rpm: float | None
) -> None:
    @virtual
    async def check() -> None:
        sim = SimZlac(1, watchdog=0, ramp_rpm=ramp_rpm)
        async with open_bus(VirtualLine(sim)) as bus:
            base = Zlac8015d(bus, 1, ramp_rpm=ramp_rpm)
            await base.enable()
            went = await base.left.run(rpm, duration=duration)
            peak = min(abs(rpm), 120 * duration)
            whole = (peak * duration if peak == 120 * duration else abs(rpm) * duration) / 60
            assert abs(went) == pytest.approx(whole, abs=max(0.03 * whole, 0.01))

    check()


@virtual
async def test_a_run_too_short_to_turn_round_slows_down_from_the_speed_that_it_has() -> None:
    async with _wheel() as (base, sim):
        await base.left.run(120)
        await base.left.run(-120, duration=0.5)  # it comes down to 60 rpm in that time
        assert not sim.left.motor.moving(asyncio.get_running_loop().time())


@virtual
async def test_where_ramps_are_steeper_than_was_told_what_to_do_is_said() -> None:
    sim = SimZlac(1, watchdog=0, ramp_rpm=1000.0)
    async with open_bus(VirtualLine(sim)) as bus:
        base = Zlac8015d(bus, 1)
        await base.enable()
        with pytest.raises(MoveFailed, match=r"whole range of speeds: then make it with ramp_rpm=1000\."):
            await base.left.run(40, duration=1.0)
