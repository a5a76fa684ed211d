"""The error of a group says how the others were when it was told: that they stood only where they were seen to."""

import asyncio
from contextlib import suppress

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.errors import BusError, MotionError, MoveCancelled, NotEnabled, NotSent
from tests.devices.group_plant import LEFT, MKS, TLR, plant
from tests.devices.mks.bench import on_virtual_clock
from tests.devices.test_group_endings import ALL, WHO, dead, fail, standing, under_way


@WHO
@on_virtual_clock
async def test_the_error_of_a_group_move_says_of_each_other_axis_that_it_is_being_stopped_or_stands(who: str) -> None:
    async with plant(*ALL) as p:
        move = await under_way(p)
        fail(p, who)
        with pytest.raises(MotionError, match="When this was told, ") as raised:
            await move
        said = str(raised.value).partition("When this was told, ")[2].rstrip(".").split(", ")
        turned = {name: p.moving(name) for name in "abc"}
        others = [name for name in "abc" if name != who]
        assert [each.split()[0] for each in said] == others
        for name, each in zip(others, said, strict=True):
            assert each == f"{name} was being stopped" or (each == f"{name} stood" and not turned[name])
        await standing(p)


@on_virtual_clock
async def test_one_that_has_arrived_already_is_said_to_have_stood() -> None:
    async with plant(MKS, TLR) as p:
        move = p.group.move_to(a=0.0, b=30.0)
        await asyncio.sleep(1.0)
        assert not p.moving("a")
        fail(p, "b")
        with pytest.raises(MotionError, match=r"^b: .* When this was told, a stood\.$"):
            await move
        await standing(p)


@on_virtual_clock
async def test_a_group_that_is_cancelled_says_how_each_of_its_axes_is() -> None:
    async with plant(MKS, TLR) as p:
        move = await under_way(p, a=30.0, b=30.0)
        move.cancel()
        with pytest.raises(MoveCancelled, match="When this was told, a was being stopped, b was being stopped"):
            await move
        await standing(p)


@on_virtual_clock
async def test_a_group_one_of_whose_ports_is_lost_says_which_axes_might_turn() -> None:
    async with plant(MKS, TLR, MKS, TLR, pairs=2, config=BusConfig(reopen_min=0.1)) as p:
        move = await under_way(p, a=300, b=100, c=300, d=100)
        p.lines[0].unplug()
        with pytest.raises(NotSent) as raised:
            await move
        assert "c might turn, with its port away" in str(raised.value)
        assert "b was being stopped" in str(raised.value)
        p.lines[0].plug()
        await asyncio.sleep(2.0)


@WHO
@on_virtual_clock
async def test_the_error_of_a_group_stream_names_the_axis_and_says_how_the_others_were(who: str) -> None:
    async with plant(*ALL) as p:
        with pytest.raises(MotionError, match=rf"^{who}: .*When this was told, ") as raised:
            async with p.group.stream(timeout=30.0, acceleration=500.0) as setpoint:
                setpoint(a=200, b=200, c=100)
                await asyncio.sleep(1.0)
                fail(p, who)
                await asyncio.sleep(1.0)
        for name in "abc":
            assert (f"{name} was being stopped" in str(raised.value) or f"{name} stood" in str(raised.value)) is (
                name != who
            )
        await standing(p)


@pytest.mark.parametrize("how", ["refuses", "is silent"])
@on_virtual_clock
async def test_a_group_stream_that_one_axis_does_not_take_ends_when_those_that_turned_before_were_seen_standing(
    how: str,
) -> None:
    async with plant(MKS, LEFT, TLR) as p:
        a, b = p.axes["a"], p.axes["b"]
        await asyncio.gather(a.run(200), b.run(50))
        assert p.moving("a")
        back = None
        if how == "refuses":
            await p.axes["c"].disable()
        else:
            back = dead(p, "c")
        with pytest.raises(NotEnabled if how == "refuses" else BusError, match=r"^c: .*a stood, b stood") as raised:
            async with p.group.stream():
                pass
        assert not p.moving("a")
        assert not p.moving("b")
        assert not isinstance(raised.value, MoveCancelled)
        if back is not None:
            back()
        with suppress(BusError):
            await p.axes["c"].stop()
