"""An application may have its tasks begin at once (`asyncio.eager_task_factory`, Python 3.12)."""

import asyncio
import sys

import anyio
import pytest

from rs485bus.errors import MoveCancelled, MoveFailed, ReferenceLost
from rs485bus.sim import Machine
from tests.devices.mks.bench import FlakyMks, bench, on_virtual_clock

pytestmark = pytest.mark.skipif(sys.version_info < (3, 12), reason="there are no eager tasks")


@on_virtual_clock
async def test_a_command_that_fails_at_once_keeps_the_next_one_from_nothing() -> None:
    asyncio.get_running_loop().set_task_factory(asyncio.eager_task_factory)  # type: ignore[attr-defined,unused-ignore]
    async with bench(FlakyMks(machine=Machine(home_switch=None))) as on:
        with pytest.raises(MoveFailed):
            await on.axis.home(timeout=1.0)
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)
        await on.axis.enable()
        await on.axis.set_zero()
        with anyio.fail_after(10):
            assert await on.axis.move_to(1.0) == pytest.approx(1.0, abs=1e-3)
            move, next_one = on.axis.move_to(5.0), on.axis.move_to(6.0)
            await anyio.sleep(0.2)
            await on.axis.stop()
        for each in (move, next_one):
            with pytest.raises(MoveCancelled):
                await each
