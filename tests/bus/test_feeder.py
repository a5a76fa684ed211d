"""What waits for a device that is due goes in place of its feed, and only where that feeds it as surely."""

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Urgency
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read
from rs485bus.sim import Noise, SimUnit
from rs485bus.sim.device import ILLEGAL_ADDRESS, Refusal
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import Request, read_holding, read_input
from rs485bus.wire.registers import Register
from tests.bus.support import BANK, Drive, drives
from tests.bus.test_emergency import guard

QUICK = BusConfig(echo=False, reply_timeout=0.01)


def ask_without_a_pause(rig: Rig, request: Request, **options: object) -> list[Outcome | None]:
    """As soon as it has ended, it is asked again. Returns how it ends each time, as it goes on."""
    ended: list[Outcome | None] = []

    def again(job: Job) -> None:
        ended.append(job.outcome)
        rig.at(rig.now, ask)

    def ask() -> None:
        rig.owner.submit(Job(request, on_end=again, **options), rig.now)  # type: ignore[arg-type]

    ask()
    return ended


def fed(rig: Rig, made: list[Drive]) -> tuple[int, float]:
    """How many feeds were sent, and for how long a device was unheard at most."""
    watches = rig.owner.feeding.all()
    assert len(watches) == len(made)
    return sum(watch.feeds for watch in watches), max(watch.longest for watch in watches)


@pytest.mark.parametrize("urgency", [Urgency.COMMAND, Urgency.POLL])
def test_on_a_bus_that_is_never_idle_feeding_takes_nothing_from_the_wire(urgency: Urgency) -> None:
    rig = Rig(config=QUICK, keep_frames=False)
    made = drives(rig, 31)
    guard(rig, *made, timeout=0.9)
    for drive in made:
        for register in (r.POSITION, r.SPEED):
            ask_without_a_pause(rig, read(drive.address, register), urgency=urgency)
    rig.run(8.0)
    feeds, longest = fed(rig, made)
    assert feeds < 0.01 * 31 * 26
    assert longest < 0.3 + 0.0105


def test_a_poll_whose_reply_was_lost_is_followed_by_a_feed_in_time() -> None:
    rig = Rig(config=QUICK, keep_frames=False, noise=Noise(lost_reply=0.05), seed=3)
    made = drives(rig, 31)
    guard(rig, *made, timeout=1.0)
    for drive in made:
        ask_without_a_pause(rig, read(drive.address, r.POSITION), urgency=Urgency.POLL)
    rig.run(10.0)
    feeds, longest = fed(rig, made)
    assert 0 < feeds < 0.1 * 31 * 30
    assert longest < 0.6
    assert all(not drive.interruptions for drive in made)


def test_what_is_refused_again_and_again_does_not_keep_its_device_from_being_fed() -> None:
    rig = Rig(config=QUICK, keep_frames=False)
    (drive,) = drives(rig, 1)
    answer = drive.sim.answer

    def refuse(pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        if pdu[1:3] == b"\x40\x00":
            raise Refusal(ILLEGAL_ADDRESS)
        return answer(pdu, now, broadcast=broadcast)

    drive.sim.answer = refuse  # type: ignore[method-assign]
    guard(rig, drive, timeout=0.6)
    ended = ask_without_a_pause(rig, read_input(1, 0x4000, 3))
    rig.run(10.0)
    assert set(ended) == {Outcome.REFUSED}
    feeds, longest = fed(rig, [drive])
    assert feeds >= 45
    assert longest < 0.25


@pytest.mark.parametrize(("reply_timeout", "stands_in"), [(None, True), (0.05, False)])
def test_what_may_take_longer_than_a_feed_does_not_go_in_its_place(
    reply_timeout: float | None, stands_in: bool
) -> None:
    rig = Rig(*(SimUnit(100 + at, BANK) for at in range(4)), config=QUICK, keep_frames=False)
    made = drives(rig, 16)
    guard(rig, *made, timeout=1.0)
    for at in range(4):
        ask_without_a_pause(rig, read_holding(100 + at, 0, 4))
    for drive in made:
        ask_without_a_pause(rig, read(drive.address, r.POSITION), urgency=Urgency.POLL, reply_timeout=reply_timeout)
    rig.run(10.0)
    feeds, longest = fed(rig, made)
    assert feeds < 5 if stands_in else feeds > 50
    assert longest < 1 / 3 + 0.0105


@pytest.mark.parametrize("register", [r.STATUS, r.POSITION, r.PULSES])
def test_behind_a_gateway_no_feed_keeps_owed_what_somebody_waits_for(register: Register[int]) -> None:
    """An equal answer to a feed could be the one that is owed, and so one is owed for as long again."""
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.05), noise=Noise(lost_reply=0.1), seed=3, gateway=True)
    guard(rig, *drives(rig, 1), timeout=1.0)
    waited: list[float] = []

    def ask() -> None:
        rig.owner.submit(Job(read(1, register), on_end=again), rig.now)

    def again(job: Job) -> None:
        waited.append(rig.now - job.queued_at)
        rig.at(rig.now + 0.1, ask)

    ask()
    rig.run(60.0)
    assert len(waited) > 50
    assert max(waited) < 5.1
