"""Closing an owner ends everything that it drives: jobs, halts, procedures, whatever they wait for."""

import pytest

from rs485bus.bus.schedule.endings import Endings
from rs485bus.bus.schedule.job import Job, Outcome, Reason
from rs485bus.bus.stopping.closing import shut_down
from rs485bus.bus.stopping.halt import Halted, Procedure
from rs485bus.bus.watchdog.guarding import EmergencyReport, emergency_stop
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, write
from rs485bus.sim import SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.sim.treatment import Treatment
from rs485bus.wire.frames import read_holding, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.support import BANK
from tests.bus.test_emergency import press
from tests.bus.test_stops import running


def test_a_procedure_that_waits_for_a_time_a_job_a_halt_or_another_ends_when_the_bus_is_closed() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    drive.sim._commands[0xF7] = lambda value, now: None
    ended: list[str] = []
    job, endings = Job(read(1, r.VERSION), internal=True), Endings[None](1)

    def waits_for(what: object) -> Procedure[None]:
        yield what  # type: ignore[misc]

    halt = drive.stop(rig)
    for name, what in {"job": job, "halt": halt, "time": rig.now + 1e6, "procedure": endings}.items():
        rig.owner.start(waits_for(what), lambda _, name=name: ended.append(name))  # type: ignore[misc]
    rig.owner.start(waits_for(rig.now + 1e6), endings.ending(0))
    reports = press(rig)
    rig.run(0.002)
    rig.owner.close(rig.now)
    assert sorted(ended) == ["halt", "job", "procedure", "time"]
    assert [device.standing for device in reports[0].devices] == [False]
    assert [halted.standing for halted in drive.halted] == [False]
    assert rig.owner.units[1].halt is None
    assert drive.attached.motion.may_move  # nobody has seen it stand


def test_a_stop_that_was_reported_in_vain_is_tried_no_more_once_the_bus_is_closed(
    caplog: pytest.LogCaptureFixture,
) -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    rig.pair.script = lambda frame, now: Treatment(heard=False)
    drive.stop(rig)
    ended: list[list[Halted]] = []
    rig.owner.start(shut_down(rig.owner, leave_running=False), ended.append)
    rig.run(20.0)
    assert [halted.standing for halted in ended[0]] == [False]
    assert caplog.text == ""  # it went round in circles, as a stop that ends at once was told once more


def test_whoever_stops_a_drive_on_a_closed_bus_is_told_at_once_that_it_was_not_seen_standing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    reports: list[EmergencyReport] = []

    def stop(job: Job) -> None:
        drive.stop(rig, emergency=False)

    rig.submit(read_holding(9, 0, 1), on_end=stop)
    rig.owner.start(emergency_stop(rig.owner), reports.append)
    rig.owner.close(rig.now)  # which ends the read, whose caller stops the drive again
    drive.stop(rig)
    assert [halted.standing for halted in drive.halted] == [False, False]
    assert [device.standing for report in reports for device in report.devices] == [False]
    assert caplog.text == ""  # it asked and asked until Python gave up, and nobody was told


def test_a_procedure_that_never_ends_is_left_and_logged(caplog: pytest.LogCaptureFixture) -> None:
    def for_ever() -> Procedure[None]:
        while True:
            yield 0.0

    rig = Rig()
    rig.owner.start(for_ever(), lambda _: None)
    rig.owner.close(rig.now)
    assert "procedures that do not end" in caplog.text


def test_what_is_on_the_wire_says_that_the_bus_was_closed() -> None:
    rig = Rig(SimUnit(1, BANK))
    sent = rig.submit(write_single(1, 5, 7), repeat=Repeat.NEVER)
    waits = rig.submit(read_holding(1, 0, 1))
    rig.run(0.001)
    rig.owner.close(rig.now)
    assert (sent.outcome, sent.reason) == (Outcome.UNKNOWN, Reason.CLOSED)
    assert (waits.outcome, waits.reason) == (Outcome.NOT_SENT, Reason.CLOSED)


@pytest.mark.parametrize(("after", "outcome"), [(0.0002, Outcome.UNKNOWN), (0.002, Outcome.REPLY)])
def test_a_broadcast_was_sent_if_it_had_left_the_wire(after: float, outcome: Outcome) -> None:
    rig = Rig()
    job = rig.submit(write(0, r.ENABLE, 0), repeat=Repeat.NEVER)
    rig.run(after)
    rig.owner.close(rig.now)
    assert job.outcome is outcome
