"""A group starts each of its axes exactly once, whatever of the starts is lost."""

import asyncio

import pytest

from rs485bus import BusConfig
from rs485bus.errors import BusError, MoveFailed
from rs485bus.sim import Noise
from rs485bus.wire.frames import crc
from tests.devices.group_plant import LEFT, MKS, RIGHT, TLR, Plant, plant
from tests.devices.mks.bench import on_virtual_clock

STARTS = {1: b"\x10\x00\xf5", 2: b"\x06\x00\x4e\x00\x03", 3: b"\x06\x20\x0e\x00"}
"""What starts the axes of a plant of an MKS, a TL-R and both wheels of a ZLAC."""


def lose(p: Plant, name: str, times: int, *, heard: bool) -> list[float]:
    """Lose the next starts of an axis, or only their replies. When that was, as it happens."""
    sim = p.sims[name]
    receive, lost = sim.receive, list[float]()

    def lossy(frame: bytes, now: float) -> bytes | None:
        if not frame[1:].startswith(STARTS[sim.address]) or len(lost) >= times:
            return receive(frame, now)
        lost.append(now)
        if heard:
            receive(frame, now)
        return None

    sim.receive = lossy  # type: ignore[method-assign]
    return lost


@pytest.mark.parametrize("who", "abc")
@pytest.mark.parametrize("heard", [True, False])
@on_virtual_clock
async def test_a_start_that_is_lost_or_whose_reply_is_happens_once(who: str, heard: bool) -> None:
    async with plant(MKS, TLR, LEFT, RIGHT) as p:
        lost = lose(p, who, 1, heard=heard)
        targets = {"a": 4.0, "b": -3.0, "c": 2.0, "d": 1.5}
        move = p.group.move_to(**targets)
        assert await move == pytest.approx(targets, abs=0.01)
        assert len(lost) == 1
        assert [p.moves(name) for name in "abcd"] == [1, 1, 1, 1]
        for name, target in targets.items():
            assert p.turns(name) == pytest.approx(target, abs=0.01)
        assert move.skew is not None
        assert move.skew < 0.5


@pytest.mark.parametrize("who", "abc")
@on_virtual_clock
async def test_a_start_that_is_lost_again_and_again_stops_the_others(who: str) -> None:
    async with plant(MKS, TLR, LEFT, RIGHT) as p:
        lose(p, who, 1000, heard=False)
        with pytest.raises(BusError, match=rf"^{'[cd]' if who == 'c' else who}: "):
            await p.group.move_to(a=40, b=30, c=20, d=20)
        await asyncio.sleep(2.0)
        assert p.stands()
        assert p.moves(who) == 0
        assert not p.buses[0].failures()


@pytest.mark.parametrize("seed", range(4))
@on_virtual_clock
async def test_many_group_moves_on_a_bad_line_end_where_they_should(seed: int) -> None:
    noise = Noise(lost_reply=0.03, lost_request=0.02, flipped=0.01, late=0.02, stray=0.02)
    async with plant(MKS, TLR, LEFT, RIGHT, noise=noise, seed=seed, config=BusConfig(retries=5)) as p:
        there = dict.fromkeys("abcd", 0.0)
        for step in range(8):
            ways = {"a": 2.0 + step / 10, "b": -1.0, "c": 0.5, "d": (-1) ** step * 0.4}
            await p.group.move_by(**ways)
            there = {name: at + ways[name] for name, at in there.items()}
        for name, target in there.items():
            assert p.turns(name) == pytest.approx(target, abs=0.01)
            assert p.moves(name) == 8


def _sealed(frame: bytes) -> bytes:
    return frame + crc(frame)


def refuse_after_a_loss(p: Plant, name: str, frame: bytes) -> None:
    """Lose the next such write, and have its repetition refused."""
    sim = p.sims[name]
    receive, left = sim.receive, [None, _sealed(bytes((sim.address, frame[0] | 0x80, 4)))]

    def bad(got: bytes, now: float) -> bytes | None:
        return left.pop(0) if left and got[1:].startswith(frame) else receive(got, now)

    sim.receive = bad  # type: ignore[method-assign]


@pytest.mark.parametrize("way", [10.0, 0.0])
@on_virtual_clock
async def test_what_is_written_ahead_is_said_again_and_no_axis_starts_without_the_others(way: float) -> None:
    async with plant(MKS, TLR, config=BusConfig(reply_timeout=0.03)) as p:
        refuse_after_a_loss(p, "b", b"\x10\x00\x33")
        async with asyncio.timeout(60):
            move = p.group.move_to(a=10.0, b=way)
            assert await move == pytest.approx({"a": 10.0, "b": way}, abs=0.01)
        assert p.moves("a") == 1
        assert p.moves("b") <= 1
        assert move.skew is not None
        assert move.skew < 0.05


@on_virtual_clock
async def test_what_cannot_be_written_ahead_ends_the_move_for_all() -> None:
    async with plant(MKS, TLR, config=BusConfig(reply_timeout=0.03)) as p:
        for _ in range(3):
            refuse_after_a_loss(p, "b", b"\x10\x00\x33")
        with pytest.raises(MoveFailed, match="could not be told its move"):
            async with asyncio.timeout(60):
                await p.group.move_to(a=10.0, b=10.0)
        assert p.stands()
        assert (p.moves("a"), p.moves("b")) == (0, 0)
