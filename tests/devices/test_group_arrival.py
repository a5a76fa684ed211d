"""The axes of a group start together and arrive together, whatever their drives can be told."""

import asyncio
import itertools

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from rs485bus import GroupMove, MksServo
from rs485bus.errors import LimitExceeded
from rs485bus.motion.parameters import quickest, slowest
from rs485bus.motion.profile import Profile
from tests.devices.group_plant import LEFT, MKS, RIGHT, TLR, Plant, plant
from tests.devices.mks.bench import on_virtual_clock

COMPANIES = [
    (MKS, MKS),
    (MKS, TLR),
    (MKS, LEFT),
    (TLR, TLR),
    (TLR, RIGHT),
    (LEFT, RIGHT),
    (MKS, TLR, LEFT),
    (MKS, LEFT, RIGHT),
    (TLR, LEFT, RIGHT),
    (MKS, MKS, TLR),
]
companies = pytest.mark.parametrize("kinds", COMPANIES, ids="-".join)
ways = st.floats(0.05, 8.0).map(lambda turns: round(turns, 3))


def step(p: Plant, move: GroupMove, name: str) -> float:
    """By how much one step of its speed changes how long an axis takes."""
    axis, part = p.axes[name], move.moves[name]
    assert part.target is not None
    assert part.rpm is not None
    assert part.acceleration is not None
    turns = abs(part.target)
    speeds = [rpm for rpm in (part.rpm - axis.member.rpm_step, part.rpm, part.rpm + axis.member.rpm_step) if rpm > 0]
    times = [Profile(turns, rpm, part.acceleration).duration for rpm in speeds]
    return max(times) - min(times)


async def arrive(p: Plant, targets: dict[str, float], **wish: float) -> tuple[GroupMove, dict[str, float]]:
    """Go there from zero. When each arrives, in seconds after the first start."""
    move = p.group.move_to(**targets, **wish)
    reached = await move
    assert reached == pytest.approx(targets, abs=0.01)
    starts = [part.started_at for part in move.moves.values() if part.started_at is not None]
    return move, {name: at - min(starts) for name, at in p.arrivals().items() if name in targets}


@companies
@settings(max_examples=8, phases=(Phase.explicit, Phase.generate))
@given(st.data())
def test_all_arrive_within_a_hundredth_of_the_time_they_take(kinds: tuple[str, ...], data: st.DataObject) -> None:
    targets = {"abc"[at]: data.draw(ways) * data.draw(st.sampled_from((1, -1))) for at in range(len(kinds))}

    @on_virtual_clock
    async def go() -> None:
        async with plant(*kinds, delay=0.0) as p:
            move, arrivals = await arrive(p, targets)
            longest = max(arrivals.values())
            # One that cannot be so slow arrives earlier.
            slow = [name for name in targets if slowest(p.axes[name].member).seconds(abs(targets[name])) < longest]
            for one, other in itertools.combinations(sorted(set(targets) - set(slow)), 2):
                steps = step(p, move, one), step(p, move, other)
                assert abs(arrivals[one] - arrivals[other]) <= max(0.01 * longest, *steps)

    go()


@companies
@settings(max_examples=8, phases=(Phase.explicit, Phase.generate))
@given(st.data())
def test_all_take_the_time_that_was_asked_for(kinds: tuple[str, ...], data: st.DataObject) -> None:
    targets = {"abc"[at]: data.draw(ways) for at in range(len(kinds))}
    extra = data.draw(st.floats(0.0, 3.0))

    @on_virtual_clock
    async def go() -> None:
        async with plant(*kinds, delay=0.0) as p:
            # The quickest that all can, and some more.
            quick = [quickest(p.axes[name].member, 300).seconds(turns) for name, turns in targets.items()]
            duration = round(max(quick) + 0.05 + extra, 3)
            if any(slowest(p.axes[name].member).seconds(turns) < duration for name, turns in targets.items()):
                with pytest.raises(LimitExceeded, match="cannot be so slow"):
                    await p.group.move_to(**targets, duration=duration)
                return
            move, arrivals = await arrive(p, targets, duration=duration)
            for name, at in arrivals.items():
                assert abs(at - duration) <= max(0.01 * duration, step(p, move, name))

    go()


@companies
@on_virtual_clock
async def test_with_the_time_that_drives_take_to_start_all_arrive_together_too(kinds: tuple[str, ...]) -> None:
    async with plant(*kinds) as p:
        _, arrivals = await arrive(p, dict(zip(p.axes, (5.0, -3.3, 1.7), strict=False)))
        assert max(arrivals.values()) - min(arrivals.values()) <= 0.01 * max(arrivals.values())


@pytest.mark.parametrize("duration", [2.0, 3.3, 4.7])
@on_virtual_clock
async def test_eight_axes_on_a_slow_line_arrive_together_though_the_last_starts_late(duration: float) -> None:
    async with plant(*[MKS] * 8, baudrate=19200, delay=0.0) as p:
        targets = dict(zip(p.axes, (5.0, 4.1, -3.2, 6.6, 2.7, 5.5, -4.4, 3.9), strict=True))
        move, arrivals = await arrive(p, targets, duration=duration)
        assert move.skew is not None
        assert move.skew > 0.05
        assert max(arrivals.values()) - min(arrivals.values()) <= 0.01 * duration
        assert max(arrivals.values()) == pytest.approx(duration, rel=0.01)


@on_virtual_clock
async def test_both_wheels_of_a_drive_are_started_by_one_frame() -> None:
    async with plant(LEFT, RIGHT) as p:
        move, arrivals = await arrive(p, {"a": 2.0, "b": 1.1})
        assert move.skew == 0.0
        assert p.moves("a") == p.moves("b") == 1
        assert abs(arrivals["a"] - arrivals["b"]) < 0.01


@on_virtual_clock
async def test_the_starts_follow_each_other_without_anything_between_on_a_bus_that_is_never_idle() -> None:
    async with plant(MKS, TLR, LEFT) as p:
        bus, asking = p.buses[0], True

        async def ask(address: int, register: int) -> None:
            while asking:
                await bus.unit(address).read_holding_registers(register, 1)

        polls = [asyncio.create_task(ask(2, 0x04)), asyncio.create_task(ask(3, 0x20A2))]
        move = p.group.move_to(a=3, b=3, c=2)
        assert move.skew is None
        await move
        asking = False
        await asyncio.gather(*polls)
        assert move.skew is not None
        assert move.skew < 0.015
        starts = sorted(part.started_at for part in move.moves.values() if part.started_at is not None)
        between = [record for record in bus.flight if starts[0] < record.sent_at < starts[-1]]
        assert len(between) <= 1  # the start of the second one


@on_virtual_clock
async def test_on_two_buses_all_start_at_the_same_moment() -> None:
    async with plant(MKS, TLR, MKS, TLR, pairs=2) as p:
        busy = [asyncio.create_task(bus.unit(99).read_holding_registers(0, 1)) for bus in p.buses[:1]]
        move, arrivals = await arrive(p, {"a": 3.0, "b": 2.0, "c": 1.0, "d": 4.0})
        await asyncio.gather(*busy, return_exceptions=True)
        first = [move.moves[name].started_at for name in ("a", "b")]
        assert first[0] == first[1]
        assert max(arrivals.values()) - min(arrivals.values()) <= 0.01 * max(arrivals.values())


@on_virtual_clock
async def test_who_is_there_already_and_who_is_not_named_does_not_move() -> None:
    async with plant(MKS, MKS, MKS) as p:
        await p.group.move_to(a=2, b=2)
        reached = await p.group.move_to(a=2, b=3, duration=2)
        assert reached == pytest.approx({"a": 2, "b": 3})
        assert p.turns("c") == 0


@on_virtual_clock
async def test_a_distance_is_gone_from_where_each_stands() -> None:
    async with plant(MKS, TLR) as p:
        await p.group.move_by(a=1, b=-2)
        assert await p.group.move_by(a=1, b=0.5, duration=2) == pytest.approx({"a": 2, "b": -1.5})
        assert await p.group.positions() == pytest.approx({"a": 2, "b": -1.5})


@on_virtual_clock
async def test_the_speed_of_a_group_is_a_bound_for_all() -> None:
    async with plant(MKS, TLR) as p:
        move = p.group.move_to(a=10, b=1, rpm=100)
        await move
        assert move.moves["a"].rpm == 100
        assert (move.moves["b"].rpm or 0) < 20


@pytest.mark.parametrize("known", [True, False])
@on_virtual_clock
async def test_a_duration_that_an_axis_cannot_keep_says_which_axis_and_what_it_can(known: bool) -> None:
    async with plant(MKS, TLR) as p:
        if known:
            await p.group.move_to(a=0.5, b=0.5)
        before = p.moves("a"), p.moves("b")
        for targets, duration, message in (
            ({"a": 100, "b": 1}, 0.3, r"a: MKS 1 needs \d+\.\d+ s at least for its"),
            ({"a": 100, "b": 1}, 100.0, r"b: TL-R 2 cannot be so slow that its .* turns take 100 s"),
        ):
            if known:
                with pytest.raises(LimitExceeded, match=message):
                    p.group.move_to(**targets, duration=duration)  # type: ignore[arg-type]
            else:
                move = p.group.move_to(**targets, duration=duration)  # type: ignore[arg-type]
                with pytest.raises(LimitExceeded, match=message):
                    await move
        assert (p.moves("a"), p.moves("b")) == before
        await p.group.move_to(a=1, b=1)


@on_virtual_clock
async def test_the_shortest_time_that_was_named_can_be_had() -> None:
    async with plant(MKS, TLR) as p:
        with pytest.raises(LimitExceeded) as raised:
            await p.group.move_to(a=50, b=50, duration=0.1)
        words = str(raised.value).split()
        shortest = float(words[words.index("needs") + 1])
        with pytest.raises(LimitExceeded):
            await p.group.move_to(a=50, b=50, duration=0.98 * shortest)
        await p.group.move_to(a=50, b=50, duration=shortest)


@on_virtual_clock
async def test_ramps_are_never_quicker_than_the_axis_is_to_have() -> None:
    async with plant(MKS, TLR, LEFT) as p:
        p.axes["a"].acceleration = 200.0
        for duration in (4.0, 6.0, 9.0):
            move = p.group.move_by(a=7, b=7, c=2, duration=duration)
            await move
            assert (move.moves["a"].acceleration or 0) <= 202
    assert isinstance(p.axes["a"], MksServo)
