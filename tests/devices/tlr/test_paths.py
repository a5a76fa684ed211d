"""Paths and speed paths, chosen and triggered by inputs (TL-R manual, 3.2, 3.3)."""

import asyncio

import pytest

from rs485bus.devices.tlr import (
    PATHS_BY_INPUTS,
    SPEED_PATHS_BY_INPUTS,
    DiFunction,
    Path,
    PathMode,
    PathTrigger,
    SpeedPath,
)
from rs485bus.devices.tlr import registers as r
from rs485bus.errors import LimitExceeded, ReferenceLost
from rs485bus.sim import SimTlr, TlrMachine
from tests.devices.tlr.support import TRIGGERS, lose, now, stepper_on
from tests.integration.support import virtual


def bare(**options: object) -> SimTlr:
    """A drive whose inputs nothing is wired to but what a test closes."""
    return SimTlr(machine=TlrMachine(origin=None), **options)  # type: ignore[arg-type] # options of SimTlr


def select(sim: SimTlr, path: int) -> None:
    """Set the four selection switches."""
    for switch in range(4):
        sim.close(1 + switch, bool(path >> switch & 1), now())


def trigger_by_input(sim: SimTlr, path: int) -> None:
    select(sim, path)
    sim.close(0, False, now())
    sim.close(0, True, now())


async def standing(sim: SimTlr) -> float:
    await asyncio.sleep(20.0)
    assert not sim.moving(now())
    return sim.shaft(now())


@TRIGGERS
@virtual
async def test_every_path_is_gone_to_by_its_switches(trigger: str) -> None:
    sim = bare(trigger=trigger)
    async with stepper_on(sim, units_per_turn=10.0) as x:
        x.enable()
        x.inputs.assign(*PATHS_BY_INPUTS)
        x.paths.set_mode(PathMode.ABSOLUTE)
        for path in range(16):
            x.paths[path] = Path(2.5 * (path + 1), rpm=100 + path, acceleration_ms=50 + path, deceleration_ms=70 + path)
        await x.drain()
        for path in (*range(16), 0, 15, 7):
            trigger_by_input(sim, path)
            assert await standing(sim) == pytest.approx(0.25 * (path + 1))
        assert await x.paths[3] == Path(10.0, 103, 53, 73)
        # PA_062 to PA_066 of path 3: target high and low, speed, times.
        assert [sim.memory.words[address] for address in range(98, 103)] == [0, 4000, 103, 53, 73]


@TRIGGERS
@virtual
async def test_paths_are_distances_as_shipped(trigger: str) -> None:
    sim = bare(trigger=trigger)
    async with stepper_on(sim) as x:
        x.enable()
        x.inputs.assign(*PATHS_BY_INPUTS)
        x.paths[0] = Path(1.5)
        x.paths[1] = Path(-0.5)
        await x.drain()
        for path, expected in ((0, 1.5), (0, 3.0), (1, 2.5)):
            trigger_by_input(sim, path)
            assert await standing(sim) == pytest.approx(expected)


@pytest.mark.parametrize("how", list(PathTrigger))
@virtual
async def test_a_trigger_while_it_moves_interrupts_or_is_ignored(how: PathTrigger) -> None:
    sim = bare()
    async with stepper_on(sim) as x:
        x.enable()
        x.inputs.assign(*PATHS_BY_INPUTS)
        x.paths.set_mode(PathMode.ABSOLUTE)
        x.paths.set_trigger(how)
        x.paths[0] = Path(20.0)
        x.paths[1] = Path(-2.0)
        await x.drain()
        trigger_by_input(sim, 0)
        await asyncio.sleep(1.0)
        trigger_by_input(sim, 1)
        assert await standing(sim) == pytest.approx(-2.0 if how is PathTrigger.INTERRUPT else 20.0)


@TRIGGERS
@virtual
async def test_every_speed_path_turns_it_while_its_trigger_is_closed(trigger: str) -> None:
    sim = bare(trigger=trigger)
    async with stepper_on(sim) as x:
        x.enable()
        x.inputs.assign(*SPEED_PATHS_BY_INPUTS)
        for path in range(16):
            x.speed_paths[path] = SpeedPath((100 + path) * (-1) ** path, acceleration_ms=20, deceleration_ms=30)
        await x.drain()
        for path in range(16):
            trigger_by_input(sim, path)
            await asyncio.sleep(0.1)
            assert await x.velocity() == (100 + path) * (-1) ** path
            sim.close(0, False, now())
            await asyncio.sleep(0.1)
            assert await x.velocity() == 0
        assert await x.speed_paths[15] == SpeedPath(-115, 20, 30)
        assert [sim.memory.words[address] for address in range(221, 224)] == [0x10000 - 115, 20, 30]


@virtual
async def test_paths_of_an_axis_that_counts_the_other_way_round() -> None:
    sim = bare()
    async with stepper_on(sim, reverse=True) as x:
        await x.paths.set(2, Path(1.0))
        await x.speed_paths.set(2, SpeedPath(60))
        assert sim.memory.block(r.POSITION_PATHS[2])[0] == -4000
        assert sim.memory.block(r.SPEED_PATHS[2])[0] == -60
        assert (await x.paths[2]).target == 1.0
        assert (await x.speed_paths[2]).rpm == 60


@virtual
async def test_a_path_is_written_singly_where_blocks_of_five_are_truncated() -> None:
    sim = bare(truncates=4)
    async with stepper_on(sim) as x:
        await x.paths.set(9, Path(-1.0, 10, 20, 30))
        assert await x.paths[9] == Path(-1.0, 10, 20, 30)


@virtual
async def test_a_path_that_cannot_be_is_refused_before_it_is_queued() -> None:
    sim = bare()
    async with stepper_on(sim) as x:
        with pytest.raises(IndexError, match=r"16 is outside 0\.\.15"):
            x.paths[16] = Path(1.0)
        with pytest.raises(LimitExceeded, match=r"speed of path 0 3001 rpm is outside 0\.\.3000 rpm"):
            x.paths[0] = Path(1.0, rpm=3001)
        with pytest.raises(LimitExceeded, match="target of path 0"):
            x.paths[0] = Path(1e7)
        with pytest.raises(LimitExceeded, match=r"-3001 rpm is outside -3000\.\.3000 rpm"):
            x.speed_paths[0] = SpeedPath(-3001)
        assert len(x.paths) == len(x.speed_paths) == 16
        assert not sim.writes


@virtual
async def test_a_path_whose_writing_fails_is_told_by_its_handle() -> None:
    sim = bare()
    async with stepper_on(sim) as x:
        await x.set_up()
        lose(sim, 80, 99, heard=False)
        with pytest.raises(Exception, match="No reply"):
            # Five registers may be truncated; that they are not answered alone is no failure.
            sim.receive, receive = (lambda frame, now: None), sim.receive  # type: ignore[method-assign]
            await x.paths.set(0, Path(1.0))
        sim.receive = receive  # type: ignore[method-assign]


@virtual
async def test_what_an_input_moved_has_not_lost_its_reference_and_is_gone_on_from() -> None:
    sim = bare()
    async with stepper_on(sim) as x:
        x.enable()
        x.inputs.assign(*PATHS_BY_INPUTS)
        x.paths[0] = Path(1.5)
        await x.move_to(1.0)
        trigger_by_input(sim, 0)
        assert await standing(sim) == pytest.approx(2.5)
        assert await x.move_by(1.0) == 3.5
        assert await x.move_to(0.0) == 0.0
        # Unless it restarted.
        sim.power_cycle(now())
        await asyncio.sleep(1.0)
        with pytest.raises(ReferenceLost):
            await x.move_to(1.0)


@virtual
async def test_what_nothing_could_have_moved_has_lost_its_reference() -> None:
    sim = bare()
    async with stepper_on(sim) as x:
        x.enable()
        await x.move_to(1.0)
        sim.motion.motor.place(3.0, now())
        await asyncio.sleep(0.5)
        with pytest.raises(ReferenceLost, match="nobody moved it"):
            await x.move_by(1.0)


@virtual
async def test_a_move_stops_first_what_an_input_turns() -> None:
    sim = bare()
    async with stepper_on(sim) as x:
        x.enable()
        await x.inputs.set(4, DiFunction.JOG_NEGATIVE)
        sim.close(4, True, now())
        await asyncio.sleep(0.5)
        assert await x.velocity() == -60
        assert await x.move_to(0.5) == 0.5
        assert sim.shaft(now()) == pytest.approx(0.5)
