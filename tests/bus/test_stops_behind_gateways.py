"""Behind a gateway replies come late, and overtake each other: a stop is confirmed all the same, and by no late one."""

import asyncio
import random

import pytest

from rs485bus import MksServo, open_bus
from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.units.motion import NEVER
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read
from rs485bus.errors import MotionError, NoReply, OutcomeUnknown
from rs485bus.sim import Noise, SimMks, VirtualLine
from rs485bus.sim.rig import NO_ECHO, Rig
from rs485bus.wire.frames import Request, crc
from tests.bus.support import Drive
from tests.devices.mks.bench import on_virtual_clock

STATUS, ENABLED, POSITION = (read(1, register) for register in (r.STATUS, r.ENABLED, r.POSITION))
STOPPED, RUNNING = ((body := bytes((1, 4, 2, 0, code))) + crc(body) for code in (1, 4))
PLACE = (body := bytes((1, 4, 6, 0, 0, 0, 0, 0, 9))) + crc(body)


def late(*owed: tuple[Request, float]) -> PendingReplies:
    replies = PendingReplies(in_order=False)
    for request, at in owed:
        replies.unanswered(sent(request, at), at + 5)
    return replies


def sent(request: Request, at: float) -> Job:
    job = Job(request)
    job.sent_at = at
    return job


def since(replies: PendingReplies, frame: bytes, *at: float, request: Request = STATUS) -> list[float]:
    return [replies.answered(sent(request, each), each + 5, frame) for each in at]


# What is known of an answer


def test_one_equal_answer_more_than_can_be_late_was_asked_for_now() -> None:
    """One is owed, and may come twice: of three, one is new. Each further one shows the same of a later time."""
    assert since(late((STATUS, 0.0)), STOPPED, 1.0, 1.1, 1.2, 1.3) == [0.0, 0.0, 1.0, 1.1]


def test_two_owed_replies_take_one_answer_more() -> None:
    assert since(late((STATUS, 0.0), (STATUS, 0.5)), STOPPED, 1.0, 1.1, 1.2, 1.3) == [0.0, 0.0, 0.0, 1.0]


def test_another_answer_begins_the_count_anew() -> None:
    replies = late((STATUS, 0.0))
    since(replies, STOPPED, 1.0, 1.1)
    assert since(replies, RUNNING, 1.2, 1.3, 1.4) == [0.0, 0.0, 1.2]


def test_a_reply_that_overtook_another_is_not_taken_for_a_newer_one() -> None:
    """The first answer may be the one to what was just asked, and the second one the late reply."""
    replies = late((STATUS, 0.0))
    since(replies, RUNNING, 1.0)
    assert since(replies, STOPPED, 2.0) == [0.0]


def test_a_late_reply_that_comes_by_itself_may_be_the_one_to_what_was_asked_later() -> None:
    replies = late((STATUS, 0.0), (STATUS, 2.0))
    replies.arrived(STATUS, RUNNING)
    assert since(replies, STOPPED, 3.0) == [0.0]


def test_the_reply_to_something_else_that_looks_alike_tells_nothing() -> None:
    replies = late((ENABLED, 0.0))
    assert since(replies, STOPPED, 1.0, 1.1, 1.2) == [NEVER, NEVER, 1.0]
    assert since(replies, STOPPED, 1.3, request=ENABLED) == [
        NEVER
    ]  # the last of those may have been late, and come now
    assert since(replies, STOPPED, 1.4) == [NEVER]


def test_a_loss_counts_for_its_own_time_and_until_a_row_of_answers_shows_that_none_is_late() -> None:
    replies = late((STATUS, 0.0))
    since(replies, RUNNING, *(1 + each / 10 for each in range(40)))
    assert replies.must_wait(STATUS)
    since(replies, RUNNING, *(5.1 + each / 10 for each in range(20)))
    assert replies.must_wait(STATUS)  # all that was asked looks alike: the replies may come one late, each
    assert since(replies, PLACE, 8.0, request=POSITION) == [8.0]
    since(replies, RUNNING, 8.1)
    assert not replies.must_wait(STATUS)


# What that does for a stop


def stopped_after_loss(lost: Request) -> tuple[Rig, Drive, list[float]]:
    """A drive runs behind a gateway; some time before it is stopped the reply to a look was lost."""
    drive = Drive()
    rig = Rig(drive.sim, config=NO_ECHO, gateway=True)
    drive.attach(rig)
    rig.done(drive.move(rig))
    rig.run(1.0)
    plain, drop = drive.sim.receive, [lost.adu]

    def receive(frame: bytes, now: float) -> bytes | None:
        if frame in drop:
            drop.remove(frame)
            plain(frame, now)
            return None
        return plain(frame, now)

    drive.sim.receive = receive  # type: ignore[method-assign]
    rig.done(rig.submit(lost, retries=0))
    told: list[float] = []
    drive.stop(rig).listen(lambda halted: told.append(rig.now))
    return rig, drive, told


@pytest.mark.parametrize("lost", [STATUS, POSITION, ENABLED])
def test_a_stop_is_confirmed_at_once_though_a_reply_was_lost_before(lost: Request) -> None:
    rig, drive, told = stopped_after_loss(lost)
    asked_at = rig.now
    rig.run(10.0)
    assert [halted.standing for halted in drive.halted] == [True]
    assert told[0] - asked_at < 0.2


class OvertakingLine(VirtualLine):
    """A gateway that loses replies, and holds others back for some seconds, while it hands on what came after them.

    Some of those come twice. And the drives do not hear every stop.
    """

    gateway = True

    def __init__(self, *sims: SimMks, seed: int) -> None:
        super().__init__(*sims, noise=Noise(lost_reply=0.02, lost_request=0.02), seed=seed)
        self.rng = random.Random(seed)
        self.plain = self.pair._reply
        self.pair._reply = self.reply  # type: ignore[method-assign]

    def reply(self, reply: bytes, now: float) -> None:
        if self.rng.random() > 0.05:
            self.plain(reply, now)
            return
        comes = now + self.rng.uniform(0.1, 4.5)
        self.pair._at(comes, lambda now: self.pair._hear(reply, None, now))
        if self.rng.random() < 0.3:
            self.pair._at(comes + 0.1, lambda now: self.pair._hear(reply, None, now))


@pytest.mark.parametrize("seed", range(3))
@on_virtual_clock
async def test_whatever_a_gateway_holds_back_what_is_said_to_stand_does(seed: int) -> None:
    sims = [SimMks(address) for address in (1, 2, 3)]
    loop, rounds, failed = asyncio.get_running_loop(), 0, 0

    async def run_and_stop(axis: MksServo, sim: SimMks) -> None:
        nonlocal rounds, failed
        while loop.time() < ends:
            try:
                await axis.enable()
                await axis.run(120, acceleration=2000)
                await asyncio.sleep(0.1)
                await axis.stop()
                assert not sim.moving(loop.time())
                rounds += 1
            except (MotionError, NoReply, OutcomeUnknown):
                failed += 1

    async with open_bus(OvertakingLine(*sims, seed=seed)) as bus:
        ends = loop.time() + 15
        await asyncio.gather(*(run_and_stop(MksServo(bus, sim.address), sim) for sim in sims))
        for sim in sims:
            assert not sim.moving(loop.time())
    assert rounds > 10
    assert failed < rounds


@on_virtual_clock
async def test_eight_drives_behind_a_lossy_gateway_run_and_stop_without_a_doubtful_end() -> None:
    sims = [SimMks(address) for address in range(1, 9)]
    line = VirtualLine(*sims, noise=Noise(lost_reply=0.02), seed=1)
    line.gateway = True
    loop, rounds = asyncio.get_running_loop(), 0

    async def run_and_stop(axis: MksServo, sim: SimMks) -> None:
        nonlocal rounds
        await axis.enable()
        while loop.time() < ends:
            await axis.run(120, acceleration=2000)
            await asyncio.sleep(0.2)
            await axis.stop()
            assert not sim.moving(loop.time())
            rounds += 1

    async with open_bus(line) as bus:
        ends = loop.time() + 15
        await asyncio.gather(*(run_and_stop(MksServo(bus, sim.address), sim) for sim in sims))
    assert rounds > 8 * 12
