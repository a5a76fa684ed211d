"""A supply that dips for an instant: the drive starts anew between two looks, and was never silent."""

from contextlib import suppress

import anyio
import pytest

from rs485bus.errors import MotionError, MoveFailed, NotEnabled, RearmRequired, ReferenceLost
from tests.devices.mks.bench import Bench, FlakyMks, bench, on_virtual_clock, under_way


def dips(*, enabled: bool) -> FlakyMks:
    """A drive that is there again 50 ms after its supply has dipped, and has forgotten its watchdog."""
    sim = FlakyMks(enabled_at_power_on=enabled, watchdog_kept=False)
    sim.restart_takes = 0.05
    return sim


async def zero_elsewhere(on: Bench) -> float:
    """Set its zero away from where its drive began to count; where that is."""
    await on.axis.move_to(3.0)
    await on.axis.set_zero()
    return on.shaft


async def dip_under_way(on: Bench, verb: str) -> None:
    """Set it in motion, dip its supply, and wait for what becomes of it."""
    motion = on.axis.run(60) if verb == "run" else on.axis.move_to(1.0)
    await anyio.sleep(0.15)
    on.sim.restart(on.bus.now())
    with suppress(MotionError):
        await motion
    await anyio.sleep(0.5)


@pytest.mark.parametrize("verb", ["run", "move"])
@on_virtual_clock
async def test_one_that_dips_as_it_leaves_the_zero_that_was_set_is_not_trusted(verb: str) -> None:
    async with bench(dips(enabled=False)) as on:
        zero = await zero_elsewhere(on)
        await dip_under_way(on, verb)
        with pytest.raises(ReferenceLost, match="may have restarted"):
            await on.axis.move_to(0.5)
        await on.axis.enable()
        with pytest.raises(ReferenceLost, match="may have restarted"):
            await on.axis.move_to(0.5)
        assert 0.01 < on.shaft - zero < 0.4  # where it dipped


@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize("verb", ["run", "move"])
@on_virtual_clock
async def test_in_a_watchdog_block_one_that_dips_is_armed_again_before_it_moves(verb: str, enabled: bool) -> None:
    async with bench(dips(enabled=enabled)) as on:
        await zero_elsewhere(on)
        async with on.axis.watchdog(0.6):
            await dip_under_way(on, verb)
            assert on.sim.watchdog_ms == 0
            with pytest.raises((ReferenceLost, RearmRequired)):
                await on.axis.move_to(0.5)
            assert not on.sim.moving(on.bus.now())
            await on.axis.enable()
            assert on.sim.watchdog_ms == 600
            await on.axis.set_zero()
            await on.axis.move_to(0.5)


@on_virtual_clock
async def test_one_that_dips_before_it_has_left_the_zero_is_armed_again() -> None:
    async with bench(dips(enabled=True)) as on, on.axis.watchdog(0.6):
        run = on.axis.run(60)
        await anyio.sleep(0.005)
        on.sim.restart(on.bus.now())
        with suppress(MotionError):
            await run
        await anyio.sleep(0.5)
        with suppress(MotionError):
            await on.axis.run(60)
        await on.axis.enable()
        await on.axis.run(60)
        assert on.sim.watchdog_ms == 600


@on_virtual_clock
async def test_one_that_is_stopped_far_from_zero_has_not_restarted() -> None:
    async with bench(dips(enabled=True)) as on, on.axis.watchdog(0.6):
        await zero_elsewhere(on)
        move = on.axis.move_to(20.0)
        await under_way(move, 1.5)
        on.sim.receive(bytes.fromhex("010600f70001f9f8"), on.bus.now())  # another master
        with pytest.raises(MoveFailed, match="another master"):
            await move
        assert await on.axis.move_to(1.0) == pytest.approx(1.0, abs=1e-3)


@on_virtual_clock
async def test_one_that_somebody_lets_go_of_far_from_zero_is_only_not_enabled() -> None:
    async with bench(dips(enabled=True)) as on:
        await zero_elsewhere(on)
        move = on.axis.move_to(20.0)
        await under_way(move, 1.5)
        on.sim.receive(bytes.fromhex("010600f3000079f9"), on.bus.now())
        with pytest.raises(NotEnabled, match="nobody disabled it"):
            await move
        await on.axis.enable()
        assert await on.axis.move_to(1.0) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("how", ["for a time", "on and on"])
@on_virtual_clock
async def test_a_run_from_zero_whose_position_jumps_back_there_tells_of_a_restart(how: str) -> None:
    async with bench(dips(enabled=True)) as on:
        run = on.axis.run(60, duration=1.0 if how == "for a time" else None)
        await anyio.sleep(0.4)
        on.sim.restart(on.bus.now())
        with suppress(MotionError):
            await run
        await anyio.sleep(0.6)
        with pytest.raises(ReferenceLost, match="may have restarted"):
            await on.axis.move_to(0.0)
        assert on.shaft > 0.2  # that was not driven from where it is as if it were zero


@on_virtual_clock
async def test_where_a_restart_cannot_be_told_from_a_stop_by_something_else_that_is_said() -> None:
    async with bench(dips(enabled=True)) as on:
        run = on.axis.run(60, duration=1.0)
        await anyio.sleep(0.1)
        on.sim.restart(on.bus.now())
        with pytest.raises(MoveFailed, match=r"Or its drive has restarted.*home\(\) it or set_zero\(\) first"):
            await run
