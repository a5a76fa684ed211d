"""Whatever frame is lost, the wheels end where they should, and went there once."""

import asyncio

import pytest

from rs485bus import BusConfig, Move
from rs485bus.devices.zlac.values import ControlWord
from rs485bus.errors import DeviceRefused, MoveFailed, OutcomeUnknown, RearmRequired, ReferenceLost
from rs485bus.sim import Noise
from tests.devices.zlac.plant import Plant, WatchedZlac, on_virtual_clock, plant, word

STARTS = [ControlWord.START_BOTH, ControlWord.START_LEFT, ControlWord.START_RIGHT]
FAR = 0x3FFF_FFFF + 1_000_000
"""Counts beyond what an absolute target can be."""


def go(p: Plant, start: ControlWord, turns: float) -> list[Move]:
    """Set in motion what such a start word starts."""
    if start is ControlWord.START_BOTH:
        both = p.base.move_by(turns, turns)
        return [part for part in (both.left, both.right) if isinstance(part, Move)]
    wheel = p.base.left if start is ControlWord.START_LEFT else p.base.right
    return [wheel.move_by(turns)]


def gone(start: ControlWord, turns: float) -> tuple[float, float]:
    return (turns * (start is not ControlWord.START_RIGHT), turns * (start is not ControlWord.START_LEFT))


def once(start: ControlWord) -> tuple[int, int]:
    left, right = gone(start, 1)
    return int(left), int(right)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("first", [0, FAR], ids=["absolute", "relative"])
@pytest.mark.parametrize("slow", [False, True])
@on_virtual_clock
async def test_a_start_whose_answer_is_lost_happens_once(start: ControlWord, first: int, slow: bool) -> None:
    async with plant(WatchedZlac(counts=(first, first)), acceleration=10 if slow else 500) as p:
        p.sim.lose_reply(word(start))
        moves = go(p, start, 2.0)
        for move in moves:
            await move
        assert p.shafts() == pytest.approx(gone(start, 2.0), abs=0.005)
        assert p.sim.all_lost
        assert p.sim.moves == once(start)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("first", [0, FAR], ids=["absolute", "relative"])
@on_virtual_clock
async def test_a_start_that_is_lost_itself_is_sent_again(start: ControlWord, first: int) -> None:
    async with plant(WatchedZlac(counts=(first, first))) as p:
        p.sim.lose_request(word(start))
        for move in go(p, start, 2.0):
            await move
        assert p.shafts() == pytest.approx(gone(start, 2.0), abs=0.005)
        assert p.sim.all_lost
        assert p.sim.moves == once(start)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("first", [0, FAR], ids=["absolute", "relative"])
@on_virtual_clock
async def test_a_short_move_that_is_over_before_anybody_looks_is_not_made_twice(start: ControlWord, first: int) -> None:
    async with plant(WatchedZlac(counts=(first, first)), acceleration=10_000, rpm=600) as p:
        p.sim.lose_reply(word(start))
        for move in go(p, start, 0.25):
            await move
        assert p.shafts() == pytest.approx(gone(start, 0.25), abs=0.005)
        assert p.sim.moves == once(start)


@pytest.mark.parametrize("start", STARTS)
@on_virtual_clock
async def test_a_lost_answer_to_a_target_is_asked_for_again(start: ControlWord) -> None:
    async with plant() as p:
        p.sim.lose_reply("10208A" if start is not ControlWord.START_RIGHT else "10208C", times=2)
        for move in go(p, start, -1.0):
            await move
        assert p.shafts() == pytest.approx(gone(start, -1.0), abs=0.005)
        assert p.sim.moves == once(start)


@on_virtual_clock
async def test_a_lost_answer_to_a_speed_or_a_torque_changes_nothing() -> None:
    async with plant() as p:
        for frame, command in (("102088", p.base.run), ("102090", p.base.torque)):
            p.sim.lose_reply(frame, times=2)
            await command(40, 40)
            assert p.sim.all_lost
        await p.base.stop()
        assert await p.standing_for(0.5)


@pytest.mark.parametrize("frame", ["102088", "062088"])
@pytest.mark.parametrize("lost", ["request", "reply"])
@on_virtual_clock
async def test_a_speed_that_nobody_answers_is_settled_by_reading_the_target(lost: str, frame: str) -> None:
    async with plant(config=BusConfig(retries=1)) as p:
        await p.base.run(1, 1)
        (p.sim.lose_request if lost == "request" else p.sim.lose_reply)(frame, times=2)
        run = p.base.run(50, 50) if frame == "102088" else p.base.left.run(50)
        await run
        assert p.rpm()[0] == pytest.approx(50, abs=2)
        assert p.sim.all_lost


@on_virtual_clock
async def test_a_drive_that_falls_silent_at_the_start_is_stopped_and_moves_only_after_enable() -> None:
    async with plant(WatchedZlac(watchdog=0), config=BusConfig(offline_after=2)) as p:
        p.sim.lose_reply(word(ControlWord.START_LEFT))
        move = p.base.left.move_by(5.0)
        await p.sim.lost_all()
        p.sim.dead = True
        await asyncio.sleep(3.0)
        p.sim.dead = False
        with pytest.raises(OutcomeUnknown):
            await move
        await asyncio.sleep(2.0)
        assert await p.standing_for(1.0)
        with pytest.raises(RearmRequired):
            await p.base.left.move_by(1.0)
        there = p.shafts()
        await p.base.enable()
        assert p.shafts() == there
        await p.base.left.move_by(1.0)
        assert p.shafts() == pytest.approx((there[0] + 1, there[1]), abs=0.005)


@pytest.mark.parametrize("start", STARTS)
@on_virtual_clock
async def test_a_restart_before_a_repetition_is_noticed_and_nothing_is_repeated(start: ControlWord) -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.move_to(3.0, 3.0)
        p.sim.lose_request(word(start))
        moves = go(p, start, 2.0)
        await p.sim.lost_all()
        p.sim.restart_takes = 0.05
        p.sim.power_cycle(p.now)
        ended = await asyncio.gather(*(move.wait() for move in moves), return_exceptions=True)
        assert ReferenceLost in map(type, ended)
        assert p.shafts() == (3.0, 3.0)
        assert p.sim.value_writes(word(start)) == (start is ControlWord.START_BOTH)  # of the first move


@on_virtual_clock
async def test_a_restart_in_the_middle_of_a_move_ends_the_trust_in_positions() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        move = p.base.left.move_to(5.0)
        await asyncio.sleep(2.0)
        p.sim.power_cycle(p.now)
        with pytest.raises((ReferenceLost, MoveFailed)):
            await move
        await p.base.enable()
        with pytest.raises(ReferenceLost):
            await p.base.left.move_to(1.0)
        await p.base.set_zero()
        await p.base.left.move_to(1.0)
        assert p.sim.moves[0] == 2


@pytest.mark.parametrize("who", ["wheel", "pair"])
@on_virtual_clock
async def test_a_drive_that_restarts_on_its_way_to_zero_has_not_arrived_there(who: str) -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.move_to(10.0, 10.0)
        move = p.base.move_to(0.0, 0.0) if who == "pair" else p.base.left.move_to(0.0)
        await asyncio.sleep(8.0)  # more than half of it: not too early to have arrived
        p.sim.power_cycle(p.now)  # it counts from zero where it stands
        with pytest.raises(ReferenceLost, match="may have restarted"):
            await move
        await p.base.enable()
        with pytest.raises(ReferenceLost):
            await p.base.left.move_to(1.0)


@on_virtual_clock
async def test_a_restart_of_a_standing_drive_is_noticed_before_the_next_move() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.move_to(2.0, 2.0)
        p.sim.power_cycle(p.now)
        await asyncio.sleep(1.5)
        for move in (p.base.left.move_to(1.0), p.base.right.move_by(1.0)):
            with pytest.raises(ReferenceLost):
                await move
        assert p.shafts() == (2.0, 2.0)


@on_virtual_clock
async def test_a_restart_that_the_watchdog_noticed_first_ends_the_trust_in_positions_too() -> None:
    async with plant() as p:
        move = p.base.move_to(5.0, 5.0)
        await asyncio.sleep(2.0)
        p.sim.power_cycle(p.now)
        with pytest.raises(RearmRequired):
            await move
        await p.base.enable()
        there = p.shafts()
        with pytest.raises(ReferenceLost):
            await p.base.right.move_to(1.0)
        assert p.shafts() == there
        await p.base.run(10, 10)  # a speed needs no positions


@on_virtual_clock
async def test_a_start_that_the_drive_refuses_is_not_repeated() -> None:
    async with plant() as p:
        p.sim.refuse(word(ControlWord.START_LEFT))
        with pytest.raises(DeviceRefused):
            await p.base.left.move_to(1.0)
        assert p.sim.moves == (0, 0)
        await p.base.left.move_to(1.0)


@pytest.mark.parametrize("seed", range(4))
@on_virtual_clock
async def test_a_long_sequence_on_a_bad_line_ends_where_it_should(seed: int) -> None:
    noise = Noise(lost_reply=0.04, lost_request=0.03, flipped=0.02, late=0.02, stray=0.02)
    async with plant(noise=noise, seed=seed, rpm=300, acceleration=2000, config=BusConfig(retries=4)) as p:
        left = right = 0.0
        for step in range(12):
            by = 0.5 + step / 10
            await p.base.move_by(by, -by)
            await p.base.left.move_by(-0.25)
            await p.base.right.move_to(-right - by)
            left, right = left + by - 0.25, right + by
        assert p.shafts() == pytest.approx((left, -right), abs=0.005)
        assert p.line.pair.early_frames == 0
