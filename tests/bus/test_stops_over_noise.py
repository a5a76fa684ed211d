"""A stop that is repeated over noise, by plain calls."""

from __future__ import annotations

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.job import Job, Outcome, Reason
from rs485bus.bus.stopping.halt import Halt
from rs485bus.devices.mks.drive import MksDrive


class Noisy:
    """The pair is never quiet. The device is stopped again 0.1 s after the last stop."""

    late = PendingReplies()
    heard_at = float("-inf")
    is_crowded = False
    gives_up_after = 0.5

    def reply_timeout(self, since: float, reported: bool) -> float | None:
        return 0.02

    def is_noisy(self, now: float) -> bool:
        return True

    def is_cut_short(self, now: float, since: float) -> bool:
        return True

    def at_the_latest(self, sent_at: float) -> float:
        return sent_at + 0.1

    def next_at(self, now: float, sent_at: float, acknowledged: bool) -> float:
        return sent_at + 0.1


def test_where_no_look_goes_out_before_its_time_is_over_the_stop_is_repeated_then() -> None:
    drive = MksDrive(1)
    halt = Halt(drive, drive.motion, True, 0.0)
    halt.give_up()
    now, stops, in_a_moment = 0.0, 0, 0
    procedure = halt.run(Noisy())
    wanted = next(procedure)
    while stops < 20:
        before = now
        if isinstance(wanted, Job):
            is_stop = wanted.request.writes
            stops += is_stop
            # The stops go out and are acknowledged; looks wait for a gap until their time is over.
            late = not is_stop and wanted.expires_at is not None
            now = max(now, wanted.expires_at or now) if late else now + 0.01
            wanted.attempts, wanted.sent_at, wanted.ended_at = int(is_stop), now, now
            wanted.outcome = Outcome.REPLY if is_stop else Outcome.NOT_SENT
            wanted.reason = Reason.NONE if is_stop else Reason.EXPIRED
        else:
            now = max(now, float(wanted))  # type: ignore[arg-type] # a time
        in_a_moment = in_a_moment + 1 if now == before else 0
        assert in_a_moment < 10, "it asks and asks, and no time passes"
        wanted = procedure.send(now)
    assert now < 4.0


def test_it_is_said_to_be_unconfirmed_after_three_stops_only_however_long_the_looks_wait_for_their_turns() -> None:
    class Crowded(Noisy):
        looks_wait = 10.0

        def is_crowded(self, now: float) -> bool:  # type: ignore[override]
            return True

        def is_noisy(self, now: float) -> bool:
            return False

    drive, told, stops, now = MksDrive(1), [], 0, 0.0
    halt = Halt(drive, drive.motion, False, now)
    halt.listen(lambda ended: told.append(ended.stops))
    procedure = halt.run(Crowded())
    wanted = next(procedure)
    while not told:
        if isinstance(wanted, Job):
            is_stop = wanted.request.writes
            stops += is_stop
            # Stops are acknowledged; looks have a turn now and then, and are answered too late.
            wanted.attempts, wanted.sent_at = 1, now if is_stop else now + 0.9
            wanted.answered_since = wanted.sent_at
            now = wanted.ended_at = wanted.sent_at + 0.1
            wanted.outcome = Outcome.REPLY if is_stop else Outcome.NO_REPLY
        else:
            now = max(now, float(wanted))  # type: ignore[arg-type] # a time
        wanted = procedure.send(now)
    assert told == [stops] == [3]
