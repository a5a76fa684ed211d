"""However one axis of a group ends, the others are stopped before anybody is told, and go on taking commands."""

import asyncio
import itertools
from collections.abc import Callable
from typing import Any

import anyio
import pytest

from rs485bus import AxisGroup, BusConfig, MksServo, MoveState
from rs485bus.bus.record import Record
from rs485bus.devices.zlac.values import Fault
from rs485bus.errors import (
    BusError,
    DriveFault,
    EmergencyStopped,
    MotionError,
    MotorStalled,
    MoveCancelled,
    MoveFailed,
    NotEnabled,
    NotSent,
    OutcomeUnknown,
    RearmRequired,
)
from rs485bus.sim import SimMks, SimTlr, SimZlac
from tests.devices.group_plant import LEFT, MKS, RIGHT, TLR, Plant, plant
from tests.devices.mks.bench import on_virtual_clock

ALL = (MKS, TLR, LEFT)
FAR = {"a": 30.0, "b": 30.0, "c": 15.0}
WHO = pytest.mark.parametrize("who", "abc")


def is_stop(record: Record) -> bool:
    """The frames that stop each family."""
    frame = record.request
    mks = frame[1:4] == b"\x06\x00\xf7" or (frame[1:4] == b"\x10\x00\xf5" and frame[9:11] == b"\x00\x00")
    tlr = frame[1:4] == b"\x06\x00\x4e" and frame[5] & 0x60
    zlac = frame[1:6] == b"\x06\x20\x0e\x00\x05"
    return bool(mks or tlr or zlac)


def stopped(p: Plant) -> set[int]:
    """The addresses to which a stop was sent, or is on the wire now."""
    return {record.address for bus in p.buses for record in bus.flight if is_stop(record)} | {
        bus.owner.pair.job.address
        for bus in p.buses
        if bus.owner.pair.job is not None and bus.owner.pair.job.urgency == 0
    }


async def under_way(p: Plant, seconds: float = 1.0, **targets: float) -> Any:
    move = p.group.move_to(**(targets or FAR))
    await asyncio.sleep(seconds)
    assert all(p.moving(name) for name in move.moves)
    return move


async def standing(p: Plant) -> None:
    await asyncio.sleep(2.0)
    assert p.stands()


def dead(p: Plant, who: str) -> Callable[[], None]:
    """It hears nothing more. Returns what brings it back."""
    sim = p.sims[who]
    receive, sim.receive = sim.receive, lambda frame, now: None  # type: ignore[method-assign]

    def back() -> None:
        sim.receive = receive  # type: ignore[method-assign]

    return back


def fail(p: Plant, who: str) -> None:
    """Something is wrong with the drive."""
    sim = p.sims[who]
    if isinstance(sim, SimMks):
        sim.motion.machine.travel = (-1000.0, p.turns(who))
    elif isinstance(sim, SimTlr):
        sim.motion.fail(9, p.now)
    elif isinstance(sim, SimZlac):
        sim.left.fail(Fault.OVER_LOAD, p.now)


@WHO
@on_virtual_clock
async def test_a_fault_of_one_stops_the_others_before_anybody_is_told_and_says_which(who: str) -> None:
    async with plant(*ALL) as p:
        move = await under_way(p)
        told: dict[str, set[int]] = {}

        async def hear(name: str, handle: Any) -> None:
            with pytest.raises(BusError):
                await handle
            told[name] = stopped(p)

        waiting = [asyncio.create_task(hear(name, handle)) for name, handle in (*move.moves.items(), ("group", move))]
        await asyncio.sleep(0)
        fail(p, who)
        begun = p.now
        await asyncio.gather(*waiting)
        assert p.now - begun < 0.6
        others = {at for at, name in enumerate("abc", start=1) if name != who}
        assert all(others <= stops for stops in told.values())
        kind = {"a": MotorStalled, "b": DriveFault, "c": DriveFault}[who]
        with pytest.raises(kind, match=rf"^{who}: "):
            await move
        for name, part in move.moves.items():
            cause = r"^(MKS|TL-R|ZLAC)" if name == who else f"because of {who}: "
            with pytest.raises(kind if name == who else MoveCancelled, match=cause):
                await part
        await standing(p)


@WHO
@on_virtual_clock
async def test_the_others_are_told_to_stand_soon_after_one_is_seen_to_have_failed(who: str) -> None:
    async with plant(*ALL) as p:
        move = await under_way(p)
        fail(p, who)
        await asyncio.sleep(0.4)
        assert {at for at, name in enumerate("abc", start=1) if name != who} <= stopped(p)
        with pytest.raises(MotionError):
            await move
        await standing(p)


@WHO
@on_virtual_clock
async def test_one_that_stops_answering_stops_the_others(who: str) -> None:
    async with plant(*ALL, config=BusConfig(reply_timeout=0.03)) as p:
        move = await under_way(p)
        back = dead(p, who)
        await asyncio.sleep(0.4)
        assert {at for at, name in enumerate("abc", start=1) if name != who} <= stopped(p)
        await asyncio.sleep(1.6)
        back()
        # A watchdog that is on as shipped may trip before it is known that it does not stop.
        with pytest.raises((MoveFailed, RearmRequired), match=rf"^{who}: .* (stopped answering|unheard)"):
            await move
        await standing(p)


@on_virtual_clock
async def test_one_that_is_stopped_by_somebody_else_stops_the_others() -> None:
    async with plant(*ALL) as p:
        move = await under_way(p)
        mks = p.sims["a"]
        assert isinstance(mks, SimMks)
        mks.motion.stop(float("inf"), p.now)
        with pytest.raises(MoveFailed, match=r"^a: MKS 1 stands"):
            await move
        await standing(p)


@pytest.mark.parametrize("emergency", [False, True])
@WHO
@on_virtual_clock
async def test_a_stop_of_one_by_its_user_ends_the_move_of_all(who: str, emergency: bool) -> None:
    async with plant(*ALL) as p:
        move = await under_way(p)
        stop = p.axes[who].emergency_stop() if emergency else p.axes[who].stop()
        with pytest.raises(MoveCancelled, match=rf"^{who}: .* was stopped"):
            await move
        await stop
        await standing(p)
        assert all(part.state is MoveState.CANCELLED for part in move.moves.values())
        await p.group.enable()
        await p.group.move_by(a=0.5, b=0.5, c=0.5)


@pytest.mark.parametrize("how", ["group", "member", "group.stop", "group.emergency_stop", "block"])
@on_virtual_clock
async def test_a_group_move_that_is_cancelled_stops_all(how: str) -> None:
    async with plant(*ALL) as p:
        move = await under_way(p)
        if how == "block":
            with pytest.raises(ZeroDivisionError):
                async with move:
                    raise ZeroDivisionError
        elif how.startswith("group."):
            await getattr(p.group, how[6:])()
        else:
            (move if how == "group" else move.moves["b"]).cancel()
        with pytest.raises(MoveCancelled):
            await move
        assert move.done()
        await standing(p)
        await p.group.enable()
        await p.group.move_by(a=0.5, b=0.5, c=0.5)


@on_virtual_clock
async def test_an_await_that_is_cancelled_leaves_the_move_alone() -> None:
    async with plant(*ALL) as p:
        move = p.group.move_to(**FAR)
        with anyio.move_on_after(1.0):
            await move
        assert all(p.moving(name) for name in "abc")
        assert await move == pytest.approx(FAR, abs=0.01)


@on_virtual_clock
async def test_an_emergency_stop_of_the_bus_ends_a_group_move() -> None:
    async with plant(*ALL) as p:
        move = await under_way(p)
        report = await p.buses[0].emergency_stop()
        assert report.all_standing
        with pytest.raises(MoveCancelled, match="emergency stop"):
            await move
        with pytest.raises(EmergencyStopped):
            p.group.move_to(a=1)
        assert p.stands()


@on_virtual_clock
async def test_an_emergency_stop_of_one_bus_stops_what_is_on_the_other_too() -> None:
    async with plant(MKS, TLR, MKS, TLR, pairs=2) as p:
        move = await under_way(p, a=30, b=30, c=30, d=30)
        await p.buses[0].emergency_stop()
        with pytest.raises(MoveCancelled):
            await move
        await standing(p)
        await p.axes["b"].move_by(1.0)


@on_virtual_clock
async def test_a_watchdog_that_trips_ends_a_group_move() -> None:
    loop = asyncio.get_running_loop()
    async with plant(MKS, TLR, MKS) as p, p.buses[0].watchdog(p.axes["a"], timeout=0.5):
        move = await under_way(p, a=30, b=30, c=30)
        dead(p, "a")
        await asyncio.sleep(0.01)
        loop._jumping.now += 0.6  # type: ignore[attr-defined] # nothing ran for a while
        with pytest.raises(RearmRequired, match=r"^a: "):
            await move
        await standing(p)
        p.sims["a"].receive = type(p.sims["a"]).receive.__get__(p.sims["a"])  # type: ignore[method-assign]


@on_virtual_clock
async def test_a_watchdog_block_that_is_left_ends_a_group_move() -> None:
    async with plant(*ALL) as p:
        with pytest.raises(ZeroDivisionError):
            async with p.buses[0].watchdog(p.axes["a"], timeout=0.5):
                move = await under_way(p)
                raise ZeroDivisionError
        with pytest.raises(MoveCancelled, match="watchdog block was left"):
            await move
        await standing(p)


@on_virtual_clock
async def test_a_port_that_is_lost_ends_a_group_move_and_the_first_frames_after_are_stops() -> None:
    async with plant(MKS, TLR, MKS, TLR, pairs=2, config=BusConfig(reopen_min=0.1)) as p:
        move = await under_way(p, a=300, b=100, c=300, d=100)
        p.lines[0].unplug()
        with pytest.raises(NotSent, match=r"^a: .*the port was lost"):
            await asyncio.wait_for(move.wait(), 1.0)
        await asyncio.sleep(1.0)
        assert not p.moving("b")
        assert not p.moving("d")  # they are on the other bus
        seen = len(p.buses[0].flight)
        p.lines[0].plug()
        await asyncio.sleep(2.0)
        assert p.stands()
        assert all(is_stop(record) for record in p.buses[0].flight[seen : seen + 2])


@pytest.mark.parametrize("how", ["error", "cancelled", "closed"])
@on_virtual_clock
async def test_leaving_the_block_of_the_bus_stops_all(how: str) -> None:
    made: list[Plant] = []

    async def main() -> None:
        async with plant(*ALL) as p:
            made.append(p)
            move = await under_way(p)
            if how == "error":
                raise ZeroDivisionError
            if how == "closed":
                await p.buses[0].aclose()
                with pytest.raises(MoveCancelled):
                    await move
            else:
                await asyncio.sleep(1e6)

    task = asyncio.create_task(main())
    await asyncio.sleep(3.0)
    task.cancel()
    with (
        pytest.raises(ZeroDivisionError if how == "error" else asyncio.CancelledError)
        if how != "closed"
        else anyio.CancelScope()
    ):
        await task
    assert made[0].stands()


@on_virtual_clock
async def test_leaving_the_block_normally_waits_for_the_group() -> None:
    async with plant(MKS, TLR) as p:
        p.group.move_to(a=3, b=3)
    assert p.turns("a") == pytest.approx(3)
    assert p.turns("b") == pytest.approx(3, abs=0.01)


@on_virtual_clock
async def test_one_that_never_comes_to_the_move_releases_the_others() -> None:
    async with plant(MKS, TLR, MKS) as p:
        axes = p.axes
        early = axes["a"].move_to(20.0)
        move = p.group.move_to(a=1, b=1, c=1)
        behind = axes["b"].move_to(5.0)
        await asyncio.sleep(1.0)
        fail(p, "a")
        with pytest.raises(MotorStalled):
            await early
        with pytest.raises(MoveCancelled, match=r"^a: "):
            await move
        with pytest.raises(MoveCancelled):
            await behind
        assert p.moves("b") == p.moves("c") == 0
        await axes["b"].move_to(1.0)
        await axes["c"].run(60.0)
        assert not any(is_stop(record) and record.address != 1 for record in p.buses[0].flight)
        await axes["c"].stop()


@on_virtual_clock
async def test_what_an_axis_does_before_the_move_goes_on_when_the_move_is_cancelled() -> None:
    async with plant(MKS, MKS) as p:
        early = p.axes["a"].move_to(5.0)
        await p.axes["b"].run(60.0)
        move = p.group.move_to(a=1, b=1)
        await asyncio.sleep(0.2)
        move.cancel()
        with pytest.raises(MoveCancelled):
            await move
        assert await early == 5.0
        assert p.moving("b")
        await p.group.stop()


@on_virtual_clock
async def test_one_that_is_not_enabled_keeps_all_from_moving() -> None:
    async with plant(MKS, MKS, enabled=False) as p:
        await p.axes["a"].enable()
        await p.axes["b"].disable()
        with pytest.raises(NotEnabled, match=r"^b: MKS 2 is not enabled"):
            await p.group.move_to(a=1, b=1)
        assert p.moves("a") == 0
        await p.group.enable()
        await p.group.move_to(a=1, b=1)


@on_virtual_clock
async def test_two_groups_over_the_same_axes_in_different_orders_do_not_wait_for_each_other_for_ever() -> None:
    async with plant(MKS, TLR, MKS) as p:
        a, b, c = p.axes.values()
        first, second = AxisGroup(x=a, y=b, z=c), AxisGroup(z=c, y=b, x=a)
        done: list[dict[str, float]] = []

        async def go(group: AxisGroup, step: float) -> None:
            for _ in range(3):
                reached = await group.move_by(x=step, y=step, z=step)
                done.append(reached)

        async with asyncio.timeout(60.0):
            await asyncio.gather(go(first, 1.0), go(second, -0.5))
        assert len(done) == 6
        assert await first.positions() == pytest.approx({"x": 1.5, "y": 1.5, "z": 1.5}, abs=0.01)


@on_virtual_clock
async def test_wheels_of_one_drive_in_two_groups_do_not_wait_for_each_other_for_ever() -> None:
    async with plant(LEFT, RIGHT, MKS, TLR) as p:
        left, right, x, y = p.axes.values()
        one, other = AxisGroup(wheel=left, x=x), AxisGroup(y=y, wheel=right)
        right.run(30.0, duration=1.0)
        async with asyncio.timeout(60.0):
            await asyncio.gather(
                one.move_to(wheel=1, x=1), other.move_to(wheel=1, y=1), AxisGroup(x=x, y=y).move_to(x=0, y=0)
            )
        assert p.moves("a") == 1


@on_virtual_clock
async def test_a_failure_of_a_group_that_nobody_awaited_is_raised_once_from_the_block() -> None:
    with pytest.raises(ExceptionGroup) as raised:
        async with plant(MKS, MKS) as p:
            await under_way(p, a=20, b=20)
            fail(p, "a")
            await asyncio.sleep(5.0)
    assert [str(error)[:9] for error in raised.value.exceptions] == ["a: MKS 1 "]


@on_virtual_clock
async def test_a_failure_that_was_raised_from_the_move_of_its_axis_is_not_raised_from_the_block_again() -> None:
    async with plant(MKS, MKS) as p:
        move = await under_way(p, a=20, b=20)
        fail(p, "a")
        with pytest.raises(MotorStalled):
            await move.moves["a"]


@on_virtual_clock
async def test_a_failure_that_was_seen_lets_all_axes_take_commands_again() -> None:
    async with plant(MKS, MKS) as p:
        move = await under_way(p, a=20, b=20)
        fail(p, "a")
        with pytest.raises(MotorStalled):
            await move
        p.axes["b"].move_to(1.0)
        p.axes["a"].move_to(0.0)
    assert p.turns("b") == pytest.approx(1.0)


@on_virtual_clock
async def test_a_group_that_would_keep_armed_watchdogs_waiting_is_refused_before_anything_moves() -> None:
    config = BusConfig(reply_timeout=0.03, turnaround=0.02)
    async with plant(*[MKS] * 8, config=config) as p, p.buses[0].watchdog(*p.axes.values(), timeout=0.3):
        with pytest.raises(NotSent, match="start this group would take the pair for so long"):
            await p.group.move_to(**dict.fromkeys("abcdefgh", 2.0))
        assert not any(p.moves(name) for name in p.axes)
        await p.group.move_to(a=1, b=1)


@on_virtual_clock
async def test_guarded_drives_move_as_a_group_and_never_trip() -> None:
    async with plant(MKS, TLR, MKS, LEFT) as p:
        guarded = [axis for name, axis in p.axes.items() if name != "b"]
        async with p.buses[0].watchdog(*guarded, timeout=1.0):
            await p.group.move_to(a=20, b=10, c=15, d=3)
        mks = p.sims["a"]
        assert isinstance(mks, SimMks)
        assert not mks.trips


@on_virtual_clock
async def test_every_axis_is_looked_at_every_tenth_of_a_second_while_any_moves() -> None:
    async with plant(MKS, TLR, LEFT, MKS) as p:
        move = p.group.move_to(a=20, b=10, c=6, d=5)
        await move
        starts = [part.started_at for part in move.moves.values()]
        ended = max(p.arrivals().values())
        for address in (1, 2, 3, 4):
            looks = [
                record.sent_at
                for record in p.buses[0].flight
                if record.address == address and record.request[1] in (3, 4) and record.sent_at < ended
            ]
            begun = max(starts[0], looks[0])
            gaps = [late - early for early, late in itertools.pairwise(looks) if early >= begun]
            assert max(gaps) <= 0.1


def test_wrong_groups_are_refused_when_they_are_made() -> None:
    @on_virtual_clock
    async def go() -> None:
        async with plant(MKS, LEFT) as p:
            a, b = p.axes.values()
            with pytest.raises(ValueError, match="a group needs axes"):
                AxisGroup()
            with pytest.raises(ValueError, match="x and y are one axis, MKS 1"):
                AxisGroup(x=a, y=a)
            with pytest.raises(TypeError, match=r"x is .*, and no axis"):
                AxisGroup(x=p.buses[0])  # type: ignore[arg-type]
            with pytest.raises(ValueError, match="rpm says how fast"):
                AxisGroup(rpm=a)
            group = AxisGroup(x=a, y=b)
            with pytest.raises(ValueError, match="z is none of the axes of this group: x, y"):
                group.move_to(z=1)
            with pytest.raises(ValueError, match="say where"):
                group.move_to()
            for wrong in ({"rpm": 0}, {"rpm": float("nan")}, {"duration": -1}, {"x": float("inf")}):
                with pytest.raises(ValueError, match=r"above 0|no position|outside"):
                    group.move_to(**{"x": 1.0, "y": 1.0, **wrong})  # type: ignore[arg-type]
            a.limits = (0.0, 5.0)
            with pytest.raises(ValueError, match="x: MKS 1: position 6 is outside its limits"):
                group.move_to(x=6, y=1)
            with pytest.raises(BusError, match=r"y: ZLAC 2 left has no origin to find. set_zero\(\)"):
                group.home()
            assert p.moves("a") == p.moves("b") == 0
            assert isinstance(a, MksServo)

    go()


@on_virtual_clock
async def test_all_home_at_once_and_one_that_does_not_find_its_origin_is_named() -> None:
    async with plant(MKS, MKS) as p:
        assert await p.group.home() == {"a": 0.0, "b": 0.0}
        mks = p.sims["b"]
        assert isinstance(mks, SimMks)
        mks.motion.machine.home_switch = None
        with pytest.raises(MotionError, match=r"^b: MKS 2"):
            await p.group.home()
        await p.group.disable()
        with pytest.raises(NotEnabled):
            await p.group.move_to(a=1)


@on_virtual_clock
async def test_a_start_that_cannot_be_settled_stops_the_others() -> None:
    async with plant(MKS, TLR, MKS, config=BusConfig(reply_timeout=0.03)) as p:
        sim = p.sims["a"]
        receive = sim.receive

        def lossy(frame: bytes, now: float) -> bytes | None:
            if frame[1:4] == b"\x10\x00\xf5" and frame[9:11] != b"\x00\x00":
                receive(frame, now)
                sim.receive = lambda frame, now: None  # type: ignore[method-assign]
                return None
            return receive(frame, now)

        sim.receive = lossy  # type: ignore[method-assign]
        move = p.group.move_to(a=30, b=30, c=30)
        await asyncio.sleep(5.0)
        assert not p.moving("b")
        assert not p.moving("c")
        sim.receive = receive  # type: ignore[method-assign]
        with pytest.raises(OutcomeUnknown, match=r"^a: "):
            await move
        await standing(p)


@on_virtual_clock
async def test_a_start_that_is_refused_keeps_those_behind_it_from_starting() -> None:
    async with plant(MKS, MKS, TLR) as p:
        mks = p.sims["b"]
        assert isinstance(mks, SimMks)
        receive = mks.receive

        def refuse(frame: bytes, now: float) -> bytes | None:
            if frame[1:4] == b"\x10\x00\xf5":
                mks.motion.enabled = False
            return receive(frame, now)

        mks.receive = refuse  # type: ignore[method-assign]
        with pytest.raises(BusError, match=r"^b: "):
            await p.group.move_to(a=10, b=10, c=10)
        assert p.moves("c") == 0
        await standing(p)


@on_virtual_clock
async def test_none_begins_its_next_command_before_the_move_has_ended_for_all() -> None:
    async with plant(MKS, MKS, MKS) as p:
        move = p.group.move_to(a=0.0, b=5.0, c=5.0)
        following = p.axes["b"].move_to(50.0)
        while p.moves("b") == 0 or p.moving("b"):  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        sim, until = p.sims["a"], p.now + 0.25
        receive = sim.receive
        # It is asked how it is when the others arrive, and the answer is lost.
        sim.receive = lambda frame, now: None if now < until else receive(frame, now)  # type: ignore[method-assign]
        while not move.done():
            assert following.state is MoveState.QUEUED
            await asyncio.sleep(0.005)
        await move
        await following
        assert p.turns("b") == pytest.approx(50.0, abs=0.01)
        assert p.moves("b") == 2


@on_virtual_clock
async def test_leaving_its_block_after_it_has_failed_counts_as_having_seen_that() -> None:
    async with plant(MKS, MKS) as p:
        with pytest.raises(KeyError):
            async with p.group.move_to(a=20.0, b=20.0) as move:
                await asyncio.sleep(0.5)
                fail(p, "a")
                await asyncio.sleep(3.0)
                assert move.done()
                raise KeyError
        await standing(p)
        for axis in p.axes.values():
            axis.check_ready()


@pytest.mark.parametrize("kinds", [(MKS, LEFT, RIGHT), (LEFT, RIGHT), (RIGHT, TLR, LEFT)])
@pytest.mark.parametrize("side", ["left", "right"])
@on_virtual_clock
async def test_a_fault_of_a_drive_of_which_both_wheels_are_in_the_group_is_told_as_that(
    side: str, kinds: tuple[str, ...]
) -> None:
    async with plant(*kinds) as p:
        move = p.group.move_to(**dict.fromkeys("abc"[: len(kinds)], 15.0))
        await asyncio.sleep(1.0)
        sim = p.sims["abc"[kinds.index(LEFT)]]
        assert isinstance(sim, SimZlac)
        getattr(sim, side).fail(Fault.OVER_CURRENT, p.now)
        begun = p.now
        with pytest.raises(DriveFault, match=f"reports {side} over current"):
            await move
        assert p.now - begun < 0.6
        await standing(p)
