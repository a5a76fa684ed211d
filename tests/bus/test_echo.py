"""An adapter that returns what is sent looks like a slave that agrees with everything. It is found out first."""

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Outcome, Urgency
from rs485bus.sim import Noise, SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding, registers, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.support import BANK, Deaf, outcomes

AUTO = BusConfig(retries=0)
ECHO = Noise(echo=True)


def test_an_echoing_adapter_without_a_slave_never_looks_like_success() -> None:
    rig = Rig(Deaf(1), noise=ECHO, config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert job.outcome is Outcome.UNKNOWN
    assert rig.owner.pair.exchange.echo is True
    assert rig.sent[0][1][1] == 3  # a read went first


@pytest.mark.parametrize("echo", [True, False])
def test_with_a_slave_reads_and_writes_work_echo_or_not(echo: bool) -> None:
    unit = SimUnit(1, BANK)
    rig = Rig(unit, noise=Noise(echo=echo), config=AUTO)
    jobs = [
        rig.submit(write_single(1, 3, 7)),
        rig.submit(write_multiple(1, 4, [8, 9])),
        rig.submit(read_holding(1, 3, 3)),
    ]
    rig.done(*jobs)
    assert outcomes(jobs) == [Outcome.REPLY] * 3
    assert registers(jobs[2].reply) == [7, 8, 9]
    assert rig.owner.pair.exchange.echo is echo
    assert rig.pair.early_frames == 0


def test_nothing_is_written_until_it_is_settled() -> None:
    rig = Rig(SimUnit(1, BANK), config=AUTO)
    write, read = rig.submit(write_single(1, 3, 7)), rig.submit(read_holding(2, 0, 1))
    rig.done(write, read)
    assert [frame[1] for _, frame in rig.sent] == [3, 6]


def test_a_stop_goes_out_before_that_is_settled() -> None:
    rig = Rig(SimUnit(1, BANK), config=AUTO)
    stop = rig.submit(write_single(1, 3, 0), urgency=Urgency.STOP, ignores_late_replies=True)
    rig.done(stop)
    assert rig.sent[0][1] == stop.request.adu


def test_bytes_before_the_answer_leave_it_open() -> None:
    rig = Rig(SimUnit(1, BANK), noise=Noise(stray=1.0), config=AUTO)
    read = rig.submit(read_holding(1, 0, 1))
    rig.done(read)
    assert read.outcome is Outcome.REPLY
    assert rig.owner.pair.exchange.echo is None


def test_another_adapter_is_found_out_anew() -> None:
    rig = Rig(SimUnit(1, BANK), config=AUTO)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    assert rig.owner.pair.exchange.echo is False
    rig.owner.unplugged(rig.now)
    rig.owner.plugged(rig.now)
    assert rig.owner.pair.exchange.echo is None
    job = rig.submit(write_single(1, 3, 7))
    rig.done(job)
    assert job.outcome is Outcome.REPLY


def test_an_echo_that_is_seen_later_is_believed() -> None:
    rig = Rig(SimUnit(1, BANK), noise=ECHO, config=BusConfig(retries=0))
    rig.owner.pair.exchange.echo = False  # as if the first frame's echo had been lost in noise
    job = rig.submit(write_multiple(1, 4, [8, 9]))
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    assert rig.owner.pair.exchange.echo is True
