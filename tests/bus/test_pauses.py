"""Quiet before a request to a unit that wants it, whatever its neighbours do, and never past an armed watchdog."""

import asyncio
import random
from collections.abc import Callable
from typing import Any

import pytest

from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.errors import DeviceRefused, NoReply, NotSent, WatchdogInfeasible
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import Request, read_holding
from tests.bus.support import Scripted
from tests.integration.support import virtual

PAUSE = 0.025


class Meeting:
    """A rig that measures the quiet before each frame."""

    def __init__(self, *addresses: int, **config: Any) -> None:
        self.rig = Rig(*(Scripted(address) for address in addresses), config=BusConfig(echo=False, **config))
        self.quiet: list[tuple[int, float]] = []
        transmit = self.rig.pair.transmit

        def measured(data: bytes, start: float) -> None:
            pair = self.rig.pair
            last = max(pair._heard_at, pair._sending_until)
            self.quiet.append((data[0], start - last))
            transmit(data, start)

        self.rig.pair.transmit = measured  # type: ignore[method-assign] # measured on its way

    def before(self, address: int) -> list[float]:
        return [quiet for to, quiet in self.quiet if to == address]


def busy(meeting: Meeting, address: int, until: float) -> Callable[[Job | None], None]:
    """Somebody who asks a unit again as soon as it has answered."""

    def again(_: Job | None = None) -> None:
        if meeting.rig.now < until:
            meeting.rig.submit(read_holding(address, 0, 2), on_end=again)

    return again


def test_the_pair_is_quiet_before_a_request_to_it_beside_a_busy_neighbour() -> None:
    meeting = Meeting(1, 2)
    rig = meeting.rig
    rig.owner.units[2].pause = PAUSE
    end = rig.now + 2
    busy(meeting, 1, end)(None)
    busy(meeting, 2, end)(None)
    rig.run(2.5)
    shy, others = meeting.before(2)[1:], meeting.before(1)[1:]
    assert min(shy) >= PAUSE - 1e-9
    assert len(shy) >= 2 / (3 * PAUSE)
    assert min(others) < 0.002
    assert len(others) > 2 * len(shy)  # they go on while it waits for the pair to fall quiet by itself


def test_several_that_want_quiet_all_get_it() -> None:
    meeting = Meeting(1, 2, 3, 4)
    rig = meeting.rig
    for address in (2, 3, 4):
        rig.owner.units[address].pause = PAUSE
    for address in (1, 2, 3, 4):
        busy(meeting, address, rig.now + 4)(None)
    rig.run(4.5)
    for address in (2, 3, 4):
        assert min(meeting.before(address)[1:]) >= PAUSE - 1e-9
        assert len(meeting.before(address)) > 20


def test_one_request_may_want_quiet_where_its_unit_does_not() -> None:
    meeting = Meeting(1)
    rig = meeting.rig
    jobs = [rig.submit(read_holding(1, 0, 1), pause=pause) for pause in (None, 0.1, None, 0.0)]
    rig.done(*jobs)
    assert [round(quiet, 4) for quiet in meeting.before(1)[1:]] == [0.1, 0.0018, 0.0018]


def test_a_repetition_and_the_search_for_a_lost_unit_want_it_too() -> None:
    meeting = Meeting(1, 2, offline_after=1)
    rig = meeting.rig
    rig.owner.units[2].pause = PAUSE
    scripted = rig.pair.devices[1]
    assert isinstance(scripted, Scripted)
    scripted.script.extend(["deaf"] * 9)
    rig.done(*(rig.submit(read_holding(2, 0, 1)) for _ in range(3)))
    assert rig.owner.units[2].reach.offline
    busy(meeting, 1, rig.now + 10)(None)
    rig.run(10)
    assert not rig.owner.units[2].reach.offline
    assert len(meeting.before(2)) >= 10
    assert min(meeting.before(2)[1:]) >= PAUSE - 1e-9


def test_a_stop_waits_for_no_pause() -> None:
    meeting = Meeting(1, 2)
    rig = meeting.rig
    rig.owner.units[2].pause = 0.5
    rig.done(rig.submit(read_holding(1, 0, 1)))
    waiting = rig.submit(read_holding(2, 0, 1))
    rig.run(0.2)
    began = rig.now
    stop = rig.submit(read_holding(2, 1, 1), urgency=Urgency.STOP)
    rig.done(stop)
    assert stop.sent_at - began < 0.003
    rig.done(waiting)
    assert waiting.outcome is Outcome.REPLY
    assert meeting.before(2)[-1] >= 0.5 - 1e-9


def test_who_is_gone_keeps_the_pair_quiet_no_longer() -> None:
    meeting = Meeting(1, 2)
    rig = meeting.rig
    rig.owner.units[2].pause = 0.5
    rig.done(rig.submit(read_holding(1, 0, 1)))
    waiting = rig.submit(read_holding(2, 0, 1))
    again = busy(meeting, 1, rig.now + 0.7)
    rig.at(rig.now + 0.45, lambda: again(None))
    rig.run(0.6)  # by now the pair is kept quiet for it
    rig.owner.cancel(waiting, rig.now)
    assert waiting.outcome is Outcome.NOT_SENT
    other = rig.submit(read_holding(1, 1, 1))
    rig.run(0.02)
    assert other.outcome is Outcome.REPLY


def test_who_must_wait_for_a_late_reply_keeps_the_pair_quiet_no_longer() -> None:
    meeting = Meeting(1, 2, retries=0, reply_timeout=0.05)
    rig = meeting.rig
    rig.owner.units[2].pause = PAUSE
    scripted = rig.pair.devices[1]
    assert isinstance(scripted, Scripted)
    scripted.script.append("lost")
    busy(meeting, 1, rig.now + 1.0)(None)
    first, second = (rig.submit(read_holding(2, 0, 1)) for _ in range(2))
    rig.done(first)
    before = len(meeting.before(1))
    rig.done(second)
    assert (first.outcome, second.outcome) == (Outcome.NO_REPLY, Outcome.REPLY)
    assert len(meeting.before(1)) - before > 50


# Beside armed watchdogs


def both() -> VirtualLine:
    return VirtualLine(SimMks(1), Scripted(2))


@virtual
async def test_a_pause_or_a_reply_time_that_could_trip_a_watchdog_is_not_sent() -> None:
    async with open_bus(both()) as bus:
        x, meter = MksServo(bus, 1), bus.unit(2, pause=0.2, reply_timeout=0.5)
        assert await meter.read_holding_registers(0) == [100]
        async with bus.watchdog(x, timeout=0.6):
            with pytest.raises(NotSent, match="armed watchdog could trip"):
                await meter.read_holding_registers(0)
            bus.unit(2, pause=0.025, reply_timeout=0.1)
            assert await meter.read_holding_registers(0) == [100]
            with pytest.raises(NotSent, match="armed watchdog could trip"):
                await meter.read_holding_registers(0, pause=0.4)
            with pytest.raises(NotSent, match="armed watchdog could trip"):
                await meter.read_holding_registers(0, reply_timeout=0.5)
        assert await meter.read_holding_registers(0, pause=0.4, reply_timeout=0.5) == [100]


@virtual
async def test_a_guarded_drive_is_not_waited_for_longer_than_its_watchdog_allows() -> None:
    async with open_bus(both()) as bus:
        x = MksServo(bus, 1)
        async with bus.watchdog(x, timeout=0.6):
            with pytest.raises(WatchdogInfeasible, match=r"Unit 1 cannot be waited for 5000 ms"):
                bus.unit(1, reply_timeout=5)
            with pytest.raises(WatchdogInfeasible, match="Unit 1 cannot be waited for 600 ms"):
                bus.unit(1, pause=0.5)
            bus.unit(1, pause=0.01)
            await x.run(60, duration=2.0)
        bus.unit(1, reply_timeout=5)


@virtual
async def test_a_unit_that_wants_quiet_trips_no_watchdog() -> None:
    line = VirtualLine(*(drives := [SimMks(1), SimMks(3)]), Scripted(2))
    async with open_bus(line) as bus:
        x, y = MksServo(bus, 1), MksServo(bus, 3)
        meter = bus.unit(2, pause=PAUSE)
        async with bus.watchdog(x, y, timeout=0.6):
            await x.enable()
            await y.enable()
            moves = x.run(60, duration=3.0), y.run(-60, duration=3.0)
            while not all(move.done() for move in moves):
                assert await meter.read_holding_registers(0) == [100]
            for move in moves:
                await move
        assert not any(drive.trips for drive in drives)


@virtual
async def test_what_a_unit_is_set_to_stays_until_it_is_changed() -> None:
    async with open_bus(both()) as bus:
        unit = bus.unit(2, pause=0.05)
        assert bus.unit(2) is unit
        began = bus.now()
        for _ in range(5):
            await unit.read_holding_registers(0)
        assert bus.now() - began >= 0.2
        bus.unit(2, pause=0)
        began = bus.now()
        for _ in range(5):
            await unit.read_holding_registers(0)
        assert bus.now() - began < 0.05
        with pytest.raises(NoReply):
            await bus.unit(9).read_holding_registers(0)


@virtual
async def test_a_unit_that_is_only_named_is_none_that_might_hear_a_broadcast() -> None:
    async with open_bus(both()) as bus:
        bus.unit(9)
        assert 9 not in [unit.address for unit in bus.owner.units]


@virtual
async def test_a_slow_unit_is_waited_for_as_long_as_it_takes() -> None:
    class Slow(SimUnit):
        turnaround = 0.9

    async with open_bus(VirtualLine(Slow(2, {0: 5})), config=BusConfig(retries=0)) as bus:
        with pytest.raises(NoReply):
            await bus.unit(2).read_holding_registers(0)
        assert await bus.unit(2).read_holding_registers(0, reply_timeout=1.0) == [5]
        assert await bus.unit(2, reply_timeout=1.0).read_holding_registers(0) == [5]


@virtual
async def test_what_may_be_asked_of_a_unit_at_any_time_is_kept_for_it() -> None:
    from rs485bus.wire.registers import U16, Register

    async with open_bus(both()) as bus:
        status: Register[int] = Register("status", U16, address=4, function=4)
        bus.unit(2, probe=status)
        kept = bus.owner.units[2].probe
        assert isinstance(kept, Request)
        assert kept.adu[:6].hex() == "020400040001"
        bus.unit(2)
        assert bus.owner.units[2].probe is kept
        bus.unit(2, probe=False)
        assert bus.owner.units[2].probe is False
        with pytest.raises(TypeError, match=r"probe must be made like Register\(\"status\", U16, address=4\)"):
            bus.unit(2, probe=4)  # type: ignore[arg-type] # the point of the test
        with pytest.raises(DeviceRefused):
            await bus.unit(2).read_holding_registers(100)


@pytest.mark.parametrize("seed", range(12))
def test_whatever_is_asked_and_taken_back_quiet_is_kept_and_all_ends(seed: int) -> None:
    rng = random.Random(seed)
    meeting = Meeting(1, 2, 3, 4)
    rig, jobs = meeting.rig, []
    for address in (2, 3):
        rig.owner.units[address].pause = 0.01 * address
    for scripted in rig.pair.devices:
        assert isinstance(scripted, Scripted)
        scripted.script.extend(rng.choice([0.0, 0.0, 0.0, 0.0, "lost", "deaf"]) for _ in range(30))

    def ask() -> None:
        address = rng.randint(1, 4)
        pause = rng.choice([None, None, 0.03, 0.0]) if address == 4 else None
        expires = rng.choice([None, rng.uniform(0, 0.3)])
        job = rig.submit(
            read_holding(address, rng.randrange(8), 1),
            urgency=rng.choice([Urgency.COMMAND, Urgency.POLL, Urgency.STOP]),
            pause=pause,
            expires_at=None if expires is None else rig.now + expires,
        )
        jobs.append(job)
        if rng.random() < 0.1:
            rig.at(rig.now + rng.uniform(0, 0.2), lambda: rig.owner.cancel(job, rig.now))

    for _ in range(300):
        rig.at(rig.now + rng.uniform(0, 3), ask)
    rig.run(30)
    assert all(job.outcome is not None for job in jobs)
    assert rig.owner.gate.pauses.held is None or rig.owner.gate.pauses.held.outcome is not None
    wanted = {2: 0.02, 3: 0.03}
    stops = {job.request.adu for job in jobs if job.urgency is Urgency.STOP}
    for (address, quiet), (_, frame) in zip(meeting.quiet, rig.sent, strict=True):
        if frame not in stops and quiet < 1e6:
            assert quiet >= wanted.get(address, 0.0) - 1e-9


def blips(rig: Rig, every: float, until: float) -> None:
    """A byte of noise every so often."""

    def blip() -> None:
        rig.owner.feed(b"\x00", rig.now)
        if rig.now + every < until:
            rig.at(rig.now + every, blip)

    rig.at(rig.now + every, blip)


def test_who_wants_more_quiet_than_there_ever_is_is_told_so_and_keeps_nobody_waiting() -> None:
    meeting = Meeting(1, 2)
    rig = meeting.rig
    rig.owner.units[2].pause = 0.05
    end = rig.now + 20
    rig.done(rig.submit(read_holding(1, 0, 1)))
    blips(rig, 0.03, end)
    busy(meeting, 1, end)(None)
    began = rig.now
    job = rig.submit(read_holding(2, 0, 1))
    rig.done(job, within=5)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.LINE_BUSY)
    assert rig.now - began < 3
    others = len(meeting.before(1))
    assert others > (rig.now - began) / 0.02  # they went on meanwhile
    rig.owner.units[2].pause = PAUSE
    again = rig.submit(read_holding(2, 0, 1))
    rig.done(again, within=5)
    assert again.outcome is Outcome.REPLY  # that much quiet there is between two of them


def test_stops_that_go_on_and_on_do_not_keep_a_pause_from_ending() -> None:
    meeting = Meeting(1, 2)
    rig = meeting.rig
    rig.owner.units[2].pause = 0.05
    end = rig.now + 10

    def stop(_: Job | None = None) -> None:
        rig.submit(read_holding(1, 1, 1), urgency=Urgency.STOP)
        if rig.now + 0.03 < end:
            rig.at(rig.now + 0.03, stop)

    stop()
    job = rig.submit(read_holding(2, 0, 1))
    rig.done(job, within=5)
    assert job.outcome is Outcome.NOT_SENT


@virtual
async def test_a_drive_that_wants_quiet_is_fed_and_stopped_on_a_line_that_is_never_quiet_for_so_long() -> None:
    line = VirtualLine(sim := SimMks(1), other := SimMks(3))
    async with open_bus(line) as bus:
        x, y = MksServo(bus, 1), MksServo(bus, 3)
        bus.unit(1, pause=0.05)
        async with bus.watchdog(x, y, timeout=1.0):
            await x.enable()
            await y.enable()
            await asyncio.gather(x.run(60), y.run(60))
            noise = asyncio.ensure_future(babble(line, 0.03))
            await asyncio.sleep(4.0)
            await asyncio.wait_for(asyncio.gather(x.stop(), y.stop()), 5)
            noise.cancel()
        assert not sim.trips
        assert not other.trips


async def babble(line: VirtualLine, every: float) -> None:
    """A byte of noise every so often."""
    while True:
        await asyncio.sleep(every)
        assert line._sink is not None
        line._sink.received(b"\x00")
