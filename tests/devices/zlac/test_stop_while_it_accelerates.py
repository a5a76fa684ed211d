"""A wheel that is stopped, or told another speed, while it still gets faster has the ramp of the speed that it has."""

import asyncio

import pytest

from tests.devices.zlac.plant import Plant, WatchedZlac, on_virtual_clock, plant

RATE = 100.0


async def slowed_down(p: Plant, seconds: float) -> float:
    """How fast the left wheel turned, the rate with which it got slower, and how long it took to stand."""
    before, begun, rates = p.rpm()[0], p.now, []
    last, at = before, p.now
    while p.sim.rpm(p.now)[0] and p.now < begun + seconds:
        await asyncio.sleep(0.005)
        speed = p.sim.rpm(p.now)[0]
        rates.append((last - speed) / (p.now - at))
        last, at = speed, p.now
    assert max(rates) < 1.1 * RATE
    return p.now - begun


@pytest.mark.parametrize("after", [0.06, 0.3, 0.7, 1.5, 2.9, 4.0])
@pytest.mark.parametrize("both", [False, True])
@on_virtual_clock
async def test_a_stop_takes_no_longer_than_the_speed_that_it_has_needs_and_is_no_steeper(
    after: float, both: bool
) -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        moves = p.base.run(300, 300, acceleration=RATE) if both else p.base.left.run(300, acceleration=RATE)
        await asyncio.sleep(after)
        speed = p.rpm()[0]
        stopped = p.base.stop() if both else p.base.left.stop()
        assert await slowed_down(p, 5.0) < 1.3 * speed / RATE + 0.3
        await stopped
        await asyncio.wait([asyncio.ensure_future(moves.wait())])


@pytest.mark.parametrize("before", [0, 100])
@on_virtual_clock
async def test_a_stop_is_no_steeper_where_the_answer_to_the_start_is_missing(before: int) -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        if before:
            await p.base.left.run(before, acceleration=RATE)
        p.sim.lose_reply("06208800C8", times=20)
        move = p.base.left.run(200, acceleration=RATE)
        await asyncio.sleep(0.2)
        assert p.rpm()[0] > before + 12
        stopped = p.base.left.stop()
        await slowed_down(p, 10.0)
        await stopped
        await asyncio.wait([asyncio.ensure_future(move.wait())])


@on_virtual_clock
async def test_a_stop_whose_answers_are_missing_is_no_harder_where_the_wheel_is_seen_to_slow_down() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.left.run(200, acceleration=RATE)
        p.sim.lose_reply("0620880000", times=2)
        stopped = p.base.left.stop()
        assert await slowed_down(p, 5.0) < 1.5 * 200 / RATE
        await stopped
        await p.base.left.run(50, acceleration=RATE)  # it holds its motors still


@on_virtual_clock
async def test_a_stop_that_is_not_heard_is_harder_at_the_third_time() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.left.run(200, acceleration=RATE)
        p.sim.lose_request("0620880000", times=2)
        await p.base.left.stop()
        assert p.sim.all_lost
        assert p.sim.value_writes("0620880000") == 0
        assert p.sim.value_writes("06200E0005") == 1


@on_virtual_clock
async def test_a_stop_that_is_not_heard_while_the_wheel_slows_down_for_another_reason_is_said_again_soon() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.left.run(300, acceleration=RATE)
        p.base.left.run(100, acceleration=RATE, replace=True)
        await asyncio.sleep(0.2)
        p.sim.lose_request("0620880000", times=2)
        stopped = p.base.left.stop()
        await asyncio.sleep(1.0)
        assert p.sim.all_lost
        assert p.sim.value_writes("0620880000") == 1
        await stopped


@pytest.mark.parametrize("after", [0.3, 1.0, 2.0])
@on_virtual_clock
async def test_a_slower_run_during_the_ramp_of_a_faster_one_keeps_the_ramp_and_is_not_late(after: float) -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        p.base.left.run(300, acceleration=RATE)
        await asyncio.sleep(after)
        begun = p.now
        await p.base.left.run(20, acceleration=RATE, replace=True)
        assert p.now - begun < 1.3 * abs(100 * after - 20) / RATE + 0.4
