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


@pytest.mark.parametrize("after", [0.3, 1.0, 2.0])
@on_virtual_clock
async def test_a_slower_run_during_the_ramp_of_a_faster_one_keeps_the_ramp_and_is_not_late(after: float) -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        p.base.left.run(300, acceleration=RATE)
        await asyncio.sleep(after)
        begun = p.now
        await p.base.left.run(20, acceleration=RATE, replace=True)
        assert p.now - begun < 1.3 * abs(100 * after - 20) / RATE + 0.4
