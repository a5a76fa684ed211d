"""A move happens exactly once, whatever the line loses; what cannot be settled says so."""

import asyncio
from collections.abc import Callable

import pytest

from rs485bus import BusConfig, MksServo, MoveState, open_bus
from rs485bus.devices.mks import registers as r
from rs485bus.errors import MoveFailed, NoReply, OutcomeUnknown, RearmRequired, ReferenceLost
from rs485bus.sim import Noise, SimMks, VirtualLine
from tests.integration.support import bus_on, plant, virtual

MOVE = r.MOVE_TO_COUNTS.address


def lose(sim: SimMks, register: int, times: int, *, heard: bool, after: Callable[[float], None] | None = None) -> None:
    """Lose the next requests to a register, or only their replies; then let something happen."""
    receive, left = sim.receive, [times]

    def lossy(frame: bytes, now: float) -> bytes | None:
        if frame[0] != sim.address or frame[1] == 4 or frame[3] != register or not left[0]:
            return receive(frame, now)
        left[0] -= 1
        if heard:
            receive(frame, now)
        if after is not None:
            after(now)
        return None

    sim.receive = lossy  # type: ignore[method-assign]


@pytest.mark.parametrize("heard", [True, False])
@virtual
async def test_a_relative_move_whose_frame_or_reply_is_lost_moves_once(heard: bool) -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        await x.enable()
        lose(made.sims[0], MOVE, 1, heard=heard)
        start = made.shafts()[0]
        await x.move_by(2.0)
        assert made.shafts()[0] - start == pytest.approx(2.0)
        assert made.sims[0].moves == 1


@virtual
async def test_a_move_that_is_lost_three_times_fails_without_having_moved() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        await x.enable()
        lose(made.sims[0], MOVE, 3, heard=False)
        with pytest.raises(OutcomeUnknown):
            await x.move_by(2.0)
        assert made.sims[0].moves == 0


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 6])
@virtual
async def test_a_hundred_moves_on_a_bad_line_end_where_they_should(seed: int) -> None:
    noise = Noise(lost_request=0.03, lost_reply=0.03, flipped=0.02, torn=0.01, stray=0.02, duplicated=0.01)
    made = plant(3, noise=noise, seed=seed)
    async with bus_on(made) as (_, axes):
        starts = made.shafts()
        for axis in axes:
            axis.enable()
        for _ in range(30):
            for axis in axes:
                axis.move_by(0.25)
            await asyncio.gather(*(axis.drain() for axis in axes))
        for start, shaft, sim in zip(starts, made.shafts(), made.sims, strict=True):
            assert shaft - start == pytest.approx(7.5, abs=0.001)
            assert sim.moves >= 30  # an absolute target may be told twice; it is gone to once


@virtual
async def test_a_status_polled_before_a_move_and_answered_late_never_ends_the_move() -> None:
    made = plant()
    sim = made.sims[0]
    async with bus_on(made, BusConfig(reply_timeout=0.02)) as (bus, (x,)):
        await x.enable()
        answer = sim.answer

        def late_once(pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
            sim.answer = answer  # type: ignore[method-assign]
            reply = answer(pdu, now, broadcast=broadcast)
            sim.turnaround = 0.15
            return reply

        sim.answer = late_once  # type: ignore[method-assign]
        with pytest.raises(NoReply):
            await bus.unit(1).read_input_registers(r.STATUS.address, timeout=0.01)
        assert await x.move_to(5.0) == 5.0
        assert made.shafts()[0] == pytest.approx(5.5)
        assert bus.stats.units[1].late_replies >= 1


@virtual
async def test_a_drive_that_restarted_between_two_moves_has_lost_its_reference() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        x.enable()
        await x.move_to(3.0)
        made.sims[0].restart(asyncio.get_running_loop().time())
        await asyncio.sleep(2.0)
        with pytest.raises(ReferenceLost, match="may have restarted"):
            await x.move_to(4.0)
        assert made.sims[0].moves == 1
        with pytest.raises(ReferenceLost):
            await x.move_by(1.0)
        await x.set_zero()
        assert await x.move_to(1.0) == 1.0
        assert made.shafts()[0] == pytest.approx(0.5 + 3.0 + 1.0)


@virtual
async def test_a_drive_that_restarted_between_a_move_and_its_repetition_does_not_travel() -> None:
    made = plant()
    sim = made.sims[0]
    async with bus_on(made) as (_, (x,)):
        x.enable()
        await x.move_to(3.0)
        lose(sim, MOVE, 1, heard=True, after=sim.restart)
        shaft = made.shafts()[0]
        with pytest.raises((ReferenceLost, OutcomeUnknown, MoveFailed)):
            await x.move_to(10.0)
        await asyncio.sleep(3.0)
        assert made.shafts()[0] == pytest.approx(shaft, abs=0.01)
        with pytest.raises((ReferenceLost, RearmRequired)):
            await x.move_to(10.0)
        x.enable()
        with pytest.raises(ReferenceLost):
            await x.move_to(10.0)
        assert made.shafts()[0] == pytest.approx(shaft, abs=0.01)


@virtual
async def test_a_drive_that_falls_silent_in_the_middle_is_stopped_and_moves_only_after_enable() -> None:
    made = plant()
    sim = made.sims[0]
    async with bus_on(made, BusConfig(reply_timeout=0.02)) as (_, (x,)):
        x.enable()
        move = x.move_to(10.0)
        await asyncio.sleep(0.5)
        receive, sim.receive = sim.receive, lambda frame, now: None  # type: ignore[method-assign]
        with pytest.raises(MoveFailed, match="stopped answering"):
            await move
        assert move.state is MoveState.FAILED
        sim.receive = receive  # type: ignore[method-assign]
        await asyncio.sleep(20.0)
        assert made.stands()
        with pytest.raises(RearmRequired):
            await x.move_to(0.0)
        await x.enable()
        with pytest.raises(ReferenceLost):
            await x.move_to(0.0)
        await x.home()
        assert await x.move_to(1.0) == 1.0


@virtual
async def test_a_run_for_a_time_whose_reply_is_lost_is_not_begun_again() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        await x.enable()
        lose(made.sims[0], r.RUN.address, 1, heard=True)
        await x.run(300, duration=1.0)
        assert made.sims[0].moves == 1


@virtual
async def test_a_homing_whose_reply_is_lost_is_not_begun_again() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        await x.enable()
        lose(made.sims[0], r.GO_HOME.address, 1, heard=True)
        assert await x.home() == 0.0
        assert made.sims[0].moves == 1
        assert made.shafts()[0] == pytest.approx(-1.0)


@virtual
async def test_while_it_is_unplugged_moves_end_reads_wait_and_the_first_frames_after_are_stops() -> None:
    made = plant(2)
    async with bus_on(made, BusConfig(reopen_min=0.1)) as (bus, (x, y)):
        for axis in (x, y):
            axis.enable()
        moving = x.move_to(1000.0)
        await asyncio.sleep(1.0)
        made.line.unplug()
        await asyncio.sleep(0.05)
        with pytest.raises(Exception, match="the port was lost"):
            await moving
        reading = asyncio.create_task(y.position())
        await asyncio.sleep(1.0)
        assert not reading.done()
        assert not made.stands()  # nobody can stop it now
        seen = len(bus.flight)
        made.line.plug()
        await asyncio.sleep(2.0)
        assert made.stands()
        assert await reading == 0.0
        assert bus.flight[seen].request[:4] == bytes((1, 6, 0, 0xF7))
        assert await x.move_by(1.0)  # it was not watched: nothing has tripped


@virtual
async def test_a_watched_device_that_was_unplugged_must_be_armed_again() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)), x.watchdog(0.5):
        x.enable()
        x.run(600)
        await asyncio.sleep(1.0)
        made.line.unplug()
        await asyncio.sleep(1.0)
        assert made.stands()
        assert made.sims[0].trips
        made.line.plug()
        await asyncio.sleep(1.0)
        with pytest.raises(RearmRequired, match="the port was lost"):
            await x.move_by(1.0)
        await x.enable()
        await x.move_by(1.0)
        await asyncio.sleep(2.0)
        assert len(made.sims[0].trips) == 1
    assert made.watchdogs_off()


@virtual
async def test_an_event_loop_that_is_blocked_lets_the_drives_stop_themselves_and_is_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    made = plant(2)
    loop = asyncio.get_running_loop()
    async with bus_on(made) as (bus, axes), bus.watchdog(*axes, timeout=0.5):
        for axis in axes:
            axis.enable()
            axis.run(600)
        await asyncio.sleep(1.0)
        loop._jumping.now += 3.0  # type: ignore[attr-defined] # three seconds in which nothing ran
        await asyncio.sleep(0.5)
        assert [len(sim.trips) for sim in made.sims] == [1, 1]
        assert made.stands()
        for axis in axes:
            with pytest.raises(RearmRequired, match=r"unheard for 3\.\d+ s"):
                await axis.move_to(1.0)
        await asyncio.sleep(5.0)
        assert made.stands()
        assert "MKS 2 was unheard for 3" in caplog.text


@virtual
async def test_a_lease_that_is_not_renewed_stops_the_axis_until_it_is(caplog: pytest.LogCaptureFixture) -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)), x.watchdog(0.5, lease=1.0) as guard:
        x.enable()
        x.run(600)
        for _ in range(5):
            await asyncio.sleep(0.8)
            guard.renew()
        assert not made.stands()
        await asyncio.sleep(2.0)
        assert made.stands()
        assert "unheard" not in caplog.text  # its drive answers
        with pytest.raises(RearmRequired, match=r"lease of 1 s was not renewed"):
            await x.move_by(1.0)
        with pytest.raises(RearmRequired, match=r"renew\(\) the lease"):
            await x.enable()
        guard.renew()
        await x.enable()
        await x.move_by(0.1)


@virtual
async def test_two_buses_in_one_program_do_not_know_of_each_other() -> None:
    first, second = plant(), plant()
    async with bus_on(first) as (_, (x,)), open_bus(second.line) as other:
        y = MksServo(other, 1)
        x.enable()
        y.enable()
        assert await asyncio.gather(x.move_to(1.0), y.move_to(2.0)) == [1.0, 2.0]
    assert isinstance(second.line, VirtualLine)
