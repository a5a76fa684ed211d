"""Those that meet bring their parts, which are acted on once; one that leaves takes no other along."""

import asyncio

import pytest

from rs485bus.motion.group.barrier import Barrier
from tests.devices.mks.bench import on_virtual_clock


async def add(parts: dict[str, int]) -> int:
    return sum(parts.values())


@on_virtual_clock
async def test_all_get_what_comes_of_all_parts_as_often_as_they_meet() -> None:
    meeting = Barrier(["a", "b", "c"])
    for step in range(3):
        assert await asyncio.gather(*(meeting.meet(who, step, add) for who in "abc")) == [3 * step] * 3


@on_virtual_clock
async def test_one_that_is_cancelled_while_it_waits_does_not_cancel_the_others() -> None:
    meeting = Barrier(["a", "b", "c"])
    first, second = (asyncio.create_task(meeting.meet(who, 1, add)) for who in "ab")
    await asyncio.sleep(0)
    first.cancel()
    await asyncio.sleep(1.0)
    assert first.cancelled()
    assert not second.done()
    assert await asyncio.gather(second, meeting.meet("c", 1, add)) == [3, 3]


@on_virtual_clock
async def test_an_error_is_everybodys() -> None:
    async def fail(_: dict[str, int]) -> None:
        raise ZeroDivisionError

    meeting = Barrier(["a", "b"])
    ended = await asyncio.gather(*(meeting.meet(who, 1, fail) for who in "ab"), return_exceptions=True)
    assert [type(error) for error in ended] == [ZeroDivisionError] * 2
    with pytest.raises(ZeroDivisionError):
        await asyncio.gather(*(meeting.meet(who, 1, fail) for who in "ab"))
