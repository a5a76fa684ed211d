"""A dead device costs the others little, and is found again."""

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.units.probing import ProbeBudget
from rs485bus.bus.units.reachability import Reachability
from rs485bus.sim import SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding
from tests.bus.support import BANK


class Switched(SimUnit):
    """A unit that can be switched off."""

    def __init__(self, address: int) -> None:
        super().__init__(address, BANK)
        self.on = True

    def receive(self, frame: bytes, now: float) -> bytes | None:
        return super().receive(frame, now) if self.on else None


def poll(rig: Rig, addresses: range, done: dict[int, int]) -> None:
    """Poll some units, each again as soon as it has answered or was given up, and 10 ms later if it was not sent."""

    def ask(address: int) -> None:
        job = Job(read_holding(address, 0, 3), urgency=Urgency.POLL, on_end=ended)
        rig.owner.submit(job, rig.now)

    def ended(job: Job) -> None:
        done[job.address] = done.get(job.address, 0) + (job.outcome is Outcome.REPLY)
        pause = 0.01 if job.outcome is Outcome.NOT_SENT else 0.0
        rig.at(rig.now + pause, lambda: ask(job.address))

    for address in addresses:
        ask(address)


def throughput(units: int, *, dead: int = 0, seconds: float = 40.0) -> int:
    """Requests answered by the first seven of some units, the last `dead` of which are dead."""
    made = [Switched(address) for address in range(1, units + 1)]
    for unit in made[units - dead :]:
        unit.on = False
    rig = Rig(*made, keep_frames=False)
    done: dict[int, int] = {}
    poll(rig, range(1, units + 1), done)
    rig.run(seconds)
    return sum(count for address, count in done.items() if address <= 7)


def test_one_dead_unit_among_eight_leaves_the_others_95_percent() -> None:
    with_it = throughput(8, dead=1)
    assert with_it >= 0.95 * throughput(7)
    assert with_it >= 0.95 * throughput(8)


@pytest.mark.parametrize("dead", [1, 4])
def test_listening_to_dead_units_takes_less_than_5_percent_of_the_time(dead: int) -> None:
    units = [Switched(address) for address in range(1, 9)]
    for unit in units[:dead]:
        unit.on = False
    rig = Rig(*units, config=BusConfig(echo=False, reply_timeout=0.05), keep_frames=False)
    poll(rig, range(1, 9), {})
    spent = [0.0]
    rig.owner.journal.subscribe(lambda record: spent.append(record.latency) if record.outcome == "no reply" else None)
    rig.run(60.0)
    assert sum(spent) < 0.05 * 60


def test_listening_to_flapping_units_does_too() -> None:
    units = [Switched(address) for address in range(1, 9)]
    rig = Rig(*units, config=BusConfig(echo=False, reply_timeout=0.05), keep_frames=False)
    poll(rig, range(1, 9), {})

    def flap() -> None:
        for unit in units[:3]:
            unit.on = not unit.on
        rig.at(rig.now + 2.0, flap)

    flap()
    spent = [0.0]
    rig.owner.journal.subscribe(lambda record: spent.append(record.latency) if record.outcome == "no reply" else None)
    rig.run(60.0)
    assert sum(spent) < 0.05 * 60


def test_after_three_unanswered_requests_commands_fail_at_once() -> None:
    rig = Rig()
    lost = [rig.submit(read_holding(1, 0, 1)) for _ in range(3)]
    waiting = rig.submit(read_holding(1, 0, 2))
    rig.done(*lost, waiting)
    assert [job.outcome for job in lost] == [Outcome.NO_REPLY] * 3
    assert (waiting.outcome, waiting.reason) == (Outcome.NOT_SENT, Reason.OFFLINE)
    assert rig.submit(read_holding(1, 0, 1)).reason is Reason.OFFLINE


def test_a_unit_that_comes_back_is_found_by_itself() -> None:
    unit = Switched(1)
    unit.on = False
    rig = Rig(unit)
    rig.done(*(rig.submit(read_holding(1, 0, 1)) for _ in range(3)))
    unit.on = True
    rig.run(20.0)
    job = rig.submit(read_holding(1, 0, 1))
    rig.done(job)
    assert job.outcome is Outcome.REPLY


def test_a_bad_line_does_not_make_a_unit_offline() -> None:
    reach = Reachability()
    for at in range(1000):
        # Three attempts of a request are lost, and the next request is answered, again and again.
        for _ in range(3):
            assert not reach.unanswered(float(at), 0.1, 1)
        assert not reach.missed(float(at), 3)
        reach.answered()


def test_the_account_drains_with_time() -> None:
    listening = ProbeBudget(share=0.02, burst=0.25)
    listening.spend(1.0, 0.0)
    assert listening.free_at(0.0) == pytest.approx((1.0 - 0.25) / 0.02)
    assert listening.free_at(100.0) == 100.0
