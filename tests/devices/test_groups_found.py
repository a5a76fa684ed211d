"""What emulators written from the manuals alone have found of groups: none of them goes on alone, and each is told."""

from __future__ import annotations

import asyncio
import itertools

import pytest

from rs485bus import MoveState
from rs485bus.devices.mks import Status
from rs485bus.devices.mks import registers as r
from rs485bus.errors import (
    BusClosed,
    LimitExceeded,
    MotorStalled,
    MoveCancelled,
    MoveFailed,
    OutcomeUnknown,
    RequestFailed,
    StopUnconfirmed,
)
from rs485bus.sim import SimMks
from rs485bus.wire.frames import crc
from tests.devices.group_plant import LEFT, MKS, TLR, Plant, plant
from tests.devices.mks.bench import on_virtual_clock

RAMP = 300 / 1000
"""Seconds of the usual ramp."""


def hold(p: Plant, name: str) -> None:
    """Hold a shaft; the drive reports full speed and no stall."""
    sim = p.sims[name]
    assert isinstance(sim, SimMks)
    sim.put_load(9999, p.now)
    receive = sim.receive

    def quiet(frame: bytes, now: float) -> bytes | None:
        reply = receive(frame, now)
        sim.motion.stalled = False
        if sim.motion._pushing and frame[:4] == bytes((sim.address, 4, 0, r.STATUS.address)):
            reply = (body := bytes((sim.address, 4, 2, 0, Status.FULL_SPEED))) + crc(body)
        return reply

    sim.motion.stalled = False
    sim.receive = quiet  # type: ignore[method-assign]


async def until_all_stand(p: Plant, but: str, within: float) -> float:
    begun = p.now
    while any(p.moving(name) for name in p.kinds and p.axes if name != but):
        await asyncio.sleep(0.005)
        assert p.now - begun < within, [name for name in p.axes if p.moving(name)]
    return p.now - begun


# A stop is everybody's


@pytest.mark.parametrize("verb", ["stop", "emergency_stop"])
@on_virtual_clock
async def test_a_group_is_stopped_though_one_of_its_buses_is_closed(verb: str) -> None:
    async with plant(MKS, MKS, pairs=2) as p:
        p.axes["a"].run(300)
        p.axes["b"].run(300)
        await asyncio.sleep(1.0)
        await p.buses[0].aclose()
        stopped = getattr(p.group, verb)()
        with pytest.raises(BusClosed, match=r"^a: "):
            await stopped
        assert not p.moving("b")


@pytest.mark.parametrize("verb", ["stop", "emergency_stop"])
@on_virtual_clock
async def test_a_group_whose_one_port_is_away_is_told_so_in_time_and_the_others_stand(verb: str) -> None:
    async with plant(MKS, MKS, pairs=2) as p:
        p.axes["a"].run(300)
        run = p.axes["b"].run(300)
        await asyncio.sleep(1.0)
        p.lines[0].unplug()
        await asyncio.sleep(0.05)
        begun = p.now
        with pytest.raises(StopUnconfirmed, match=r"^a: .* the port is gone"):
            await getattr(p.group, verb)()
        assert p.now - begun < 2.0
        assert not p.moving("b")
        p.lines[0].plug()
        await asyncio.sleep(1.0)
        assert p.stands()
        run.seen = True
        for axis in p.axes.values():
            axis.forgive()


# One that fails


@pytest.mark.parametrize(("baudrate", "within"), [(115200, 0.6), (9600, 1.5)])
@on_virtual_clock
async def test_one_of_eight_that_is_held_stops_the_others_in_time_and_stays_stopped(
    baudrate: int, within: float
) -> None:
    async with plant(*(MKS,) * 8, baudrate=baudrate) as p:
        move = p.group.move_to(rpm=300, **dict.fromkeys(p.axes, 200.0))
        await asyncio.sleep(8.0)
        assert all(p.moving(name) for name in p.axes)
        hold(p, "c")
        after = await until_all_stand(p, "c", within + RAMP)
        assert after <= within + RAMP
        with pytest.raises(MotorStalled, match=r"^c: "):
            await move
        p.sims["c"].put_load(0, p.now)  # type: ignore[attr-defined]
        await asyncio.sleep(2.0)
        assert p.stands()  # it does not go on by itself


@on_virtual_clock
async def test_one_that_falls_silent_before_its_start_does_not_leave_the_others_alone() -> None:
    async with plant(MKS, TLR, LEFT) as p:
        sim = p.sims["a"]
        receive = sim.receive
        silent: list[bytes] = []

        def falls_silent(frame: bytes, now: float) -> bytes | None:
            if frame[:4] == bytes((1, 0x10, 0, 0xF5)):
                silent.append(frame)
            return None if silent else receive(frame, now)

        sim.receive = falls_silent  # type: ignore[method-assign]
        move = p.group.move_to(a=50, b=50, c=50)
        while not silent:  # noqa: ASYNC110 - the virtual line tells nobody
            await asyncio.sleep(0.005)
        await asyncio.sleep(0.2)
        assert p.moving("b")
        await until_all_stand(p, "a", 0.6 + 2 * RAMP)
        sim.receive = receive  # type: ignore[method-assign]
        with pytest.raises((OutcomeUnknown, MoveFailed, RequestFailed), match=r"^a: "):
            await move
        assert p.stands()


# What a group move tells


@on_virtual_clock
async def test_a_group_move_tells_how_far_it_has_come_when_it_started_and_where_its_axes_are() -> None:
    async with plant(MKS, TLR) as p:
        move = p.group.move_to(a=5, b=3)
        assert (move.state, move.started_at, move.skew) == (MoveState.QUEUED, None, None)
        seen = [at async for at in move.positions(0.2)]
        assert move.state is MoveState.DONE
        assert move.started_at is not None
        assert move.started_at < p.now
        assert len(seen) > 4
        assert seen[-1] == pytest.approx({"a": 5, "b": 3}, abs=0.01)
        assert all(earlier["a"] <= later["a"] for earlier, later in itertools.pairwise(seen))


@on_virtual_clock
async def test_the_skew_is_known_after_a_failure_too() -> None:
    async with plant(MKS, TLR) as p:
        move = p.group.move_to(a=100, b=100)
        await asyncio.sleep(2.0)
        skew = move.skew
        assert skew is not None
        await p.axes["a"].stop()
        with pytest.raises(MoveCancelled):
            await move
        assert move.skew == skew
        assert move.state in (MoveState.CANCELLED, MoveState.FAILED)


@on_virtual_clock
async def test_a_speed_below_the_lowest_is_refused_and_others_round_towards_zero() -> None:
    async with plant(MKS, TLR) as p:
        with pytest.raises(LimitExceeded, match=r"rpm 0\.1 is less than its drive can be told, which is 1"):
            p.group.move_to(a=1, b=1, rpm=0.1)
        move = p.group.move_to(a=1, b=1, rpm=200.9)
        await move
        assert max(part.rpm or 0.0 for part in move.moves.values()) <= 200.9
