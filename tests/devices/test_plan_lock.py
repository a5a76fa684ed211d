"""Plans of one drive are carried out one at a time, and each cancellation leaves the others their turns."""

import asyncio

import pytest

from rs485bus.motion.plan_lock import PlanLock
from tests.integration.support import virtual


@pytest.mark.parametrize("cancellations", [1, 2])
@virtual
async def test_a_plan_that_is_cancelled_while_it_stands_aside_gives_back_nothing(cancellations: int) -> None:
    lock, done = PlanLock(), []

    async def stands_aside() -> None:
        async with lock:
            await lock.step_aside(0.02)

    async def has_its_turn(name: str) -> None:
        async with lock:
            done.append(name)
            await asyncio.sleep(1.0)
            done.append(name)

    aside = asyncio.create_task(stands_aside())
    turns = [asyncio.create_task(has_its_turn(name)) for name in ("first", "second")]
    await asyncio.sleep(0.01)
    for _ in range(cancellations):
        aside.cancel()
        await asyncio.sleep(0)
        await asyncio.sleep(0)
    with pytest.raises(asyncio.CancelledError):
        await aside
    await asyncio.gather(*turns)
    assert done == ["first", "first", "second", "second"]
