"""Takes each defence out once, in a copy, and sees that a test fails without it.

python -m tests.defences            # all of them, some minutes
python -m tests.defences late       # those whose name has "late" in it
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.defence import Defence
from tests.defences_of_drives import DRIVES
from tests.defences_of_groups import GROUPS

ROOT = Path(__file__).parent.parent


DEFENCES = [
    *DRIVES,
    *GROUPS,
    Defence(
        "a late reply taken for the answer to an equal request",
        "bus/gate.py",
        "return station.late.must_wait(job.request, job)",
        "return READY",
        "tests/bus/test_late_replies.py",
    ),
    Defence(
        "a late reply of the same job counted as heard when it was repeated",
        "bus/late.py",
        "since = min((owed.sent_at for owed in alike), default=job.sent_at)",
        "since = job.sent_at",
        "tests/bus/test_late.py",
    ),
    Defence(
        "the second reply to a repeated request taken for a new answer",
        "bus/late.py",
        "            self.unanswered(job, until)\n        return since",
        "        return since",
        "tests/bus/test_late.py tests/bus/test_late_replies.py",
    ),
    Defence(
        "an exception that belongs to an older request",
        "bus/owner.py",
        "(kind is Kind.EXCEPTION and station.late.hides_exception(job))",
        "False",
        "tests/bus/test_late_replies.py",
    ),
    Defence(
        "what is owed forgotten when the port is lost",
        "bus/owner.py",
        "        self.stations.owes(station, job, max(self.pair.deadline, self.now))\n",
        "        if how != 'lost':\n            self.stations.owes(station, job, max(self.pair.deadline, self.now))\n",
        "tests/bus/test_late_replies.py",
    ),
    Defence(
        "replies that overtake each other behind a gateway",
        "bus/late.py",
        "        if self._in_order:\n",
        "        if True:\n",
        "tests/bus/test_late.py",
    ),
    Defence(
        "an adapter that echoes taken for a slave that agrees",
        "bus/exchange.py",
        "if not self._mirrors or self.echo is not False:",
        "if not self._mirrors:",
        "tests/bus/test_echo.py",
    ),
    Defence(
        "a write before it is known whether the adapter echoes",
        "bus/gate.py",
        "if not self.settled and job.request.writes and job.urgency is not Urgency.STOP:",
        "if False:",
        "tests/bus/test_echo.py",
    ),
    Defence(
        "noise before the first answer taken for proof that nothing echoes",
        "bus/exchange.py",
        "and self.counts()[0] == 0:",
        "and True:",
        "tests/bus/test_echo.py",
    ),
    Defence(
        "a reply with the wrong CRC",
        "wire/receiver.py",
        "if crc(frame[:-2]) == frame[-2:]:",
        "if True:",
        "tests/wire/test_receiver.py",
    ),
    Defence(
        "a reply behind a torn one lost with it",
        "wire/receiver.py",
        "            at = buffer.find(prefix, at + 1)\n        if begun < 0:",
        "            at = -1\n        if begun < 0:",
        "tests/wire/test_receiver.py",
    ),
    Defence(
        "a frame before t3.5 of silence after what was received",
        "bus/pair.py",
        "self.quiet_at = max(self._air_end, now) + self.silence",
        "self.quiet_at = max(self._air_end, now)",
        "tests/bus/test_transactions.py",
    ),
    Defence(
        "a frame before what was sent has left the wire",
        "bus/pair.py",
        "self._air_end = start + air",
        "self._air_end = start",
        "tests/bus/test_transactions.py",
    ),
    Defence(
        "a write repeated that may have been done",
        "bus/owner.py",
        "return job.repeat is Repeat.SAFE and",
        "return",
        "tests/bus/test_transactions.py",
    ),
    Defence(
        "a refusal believed although an earlier attempt may have done it",
        "bus/owner.py",
        "unknown = job.unanswered and job.request.writes",
        "unknown = False",
        "tests/bus/test_transactions.py",
    ),
    Defence(
        "a request repeated whose caller has gone",
        "bus/owner.py",
        "and not job.deserted and not expired",
        "and not expired",
        "tests/bus/test_transactions.py",
    ),
    Defence(
        "a broadcast without its turnaround",
        "bus/owner.py",
        "self._turnaround_until = max(self._turnaround_until, over)",
        "pass",
        "tests/bus/test_transactions.py",
    ),
    Defence(
        "a queue without bound",
        "bus/owner.py",
        "            reason = Reason.QUEUE_FULL\n",
        "            pass\n",
        "tests/bus/test_transactions.py",
    ),
    Defence(
        "an older moving frame after a stop",
        "bus/job.py",
        "return self.motion is not None and self.motion.epoch != self.epoch",
        "return False",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "a new move before the stop was confirmed",
        "bus/gate.py",
        "        if job.moves and station.halt is not None:\n            return _FOREVER\n",
        "",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "a stop that waits for the rest of a reply budget",
        "bus/pair.py",
        "        if not stop_waits:\n            return self.deadline\n",
        "        return self.deadline\n",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "a stop that was sent once and not confirmed",
        "bus/stopping.py",
        "if (yield from self._see_it_stand(order, now, late)):",
        "if True:",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "a motor that is about to start taken for one that stands",
        "bus/stopping.py",
        "if standing and look.answered_since >= settled:",
        "if standing:",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "an escalation that waits for the first stop to be confirmed",
        "bus/owner.py",
        "            for request in halt.again(motion, emergency):",
        "            for request in halt.again(motion, emergency)[:0]:",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "motion while an emergency stop holds",
        "bus/gate.py",
        "        if job.moves and self.latched:\n            return Reason.LATCHED\n",
        "",
        "tests/bus/test_emergency.py",
    ),
    Defence(
        "motion after an emergency stop without enabling",
        "bus/guarding.py",
        'station.locked = "an emergency stop was made"',
        "pass",
        "tests/bus/test_emergency.py tests/shell/test_wrong_input.py",
    ),
    Defence(
        "feeding a drive that does not stop",
        "bus/guarding.py",
        '        station.locked = "an emergency stop was made"\n        owner.muzzle(station)\n',
        '        station.locked = "an emergency stop was made"\n',
        "tests/bus/test_emergency.py",
    ),
    Defence(
        "a family broadcast that an unknown device might act on",
        "bus/guarding.py",
        "    if len(known) < len(everyone):",
        "    if False:",
        "tests/bus/test_emergency.py",
    ),
    Defence(
        "a dead unit that takes the wire from the others",
        "bus/gate.py",
        "        if station.reach.offline:\n            return Reason.OFFLINE\n",
        "",
        "tests/bus/test_offline.py",
    ),
    Defence(
        "units that come and go",
        "bus/reach.py",
        "        if not flaps:\n            return False\n",
        "        return False\n",
        "tests/bus/test_offline.py",
    ),
    Defence(
        "a lost unit that is never looked for on a busy wire",
        "bus/station.py",
        "        if self.to_probe_at(now) > now:\n            return None\n",
        "        return None\n",
        "tests/bus/test_offline.py",
    ),
    Defence(
        "a watchdog that is fed too late because others are due as well",
        "bus/feeding.py",
        "at = watch.due - before",
        "at = watch.due",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "feeding earlier than need be because feeds are thought to take long",
        "bus/feeding.py",
        "            watch.takes += (took - watch.takes) / 4\n",
        "            pass\n",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "feeding early what is not due soon",
        "bus/feeding.py",
        "if early <= now and watch.retry_at",
        "if watch.retry_at",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "feeding early before what somebody asked for",
        "bus/owner.py",
        "watch = self.feeding.due(self.now)\n",
        "watch = self.feeding.due(self.now) or self.feeding.soon(self.now)\n",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "an exception counted as having fed a watchdog",
        "bus/owner.py",
        "            self._end(job, Outcome.UNKNOWN if unknown else Outcome.REFUSED)\n            return\n",
        "            self._end(job, Outcome.UNKNOWN if unknown else Outcome.REFUSED)\n"
        "            self.feeding.heard(station.address, since)\n            return\n",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "watchdogs armed that cannot be fed",
        "bus/feeding.py",
        "    if needed <= available:\n",
        "    if True:\n",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "a long request while watchdogs are armed",
        "bus/gate.py",
        "            return Reason.TOO_LONG\n",
        "            pass\n",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "going on after a watchdog may have tripped",
        "bus/owner.py",
        '        station.locked = f"its watchdog may have stopped it: {reason}"\n',
        "",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "a watchdog that is turned off although nobody saw the axis stand",
        "bus/guarding.py",
        "        if not ended.standing:\n            owner.muzzle(station)\n        elif",
        "        if",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "polls that feed a drive whose lease has lapsed",
        "bus/gate.py",
        "        if station.muzzled:",
        "        if False:",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "moves that go on after the port was lost",
        "bus/owner.py",
        "            if station.attached is not None and station.attached.motion.may_move:\n",
        "            if False:\n",
        "tests/shell/test_exactly_once.py",
    ),
    Defence(
        "a failure lost to who gives up waiting in the same moment",
        "bus/handle.py",
        "        if self._unseen is not None:\n",
        "        if not self._waiters and self._unseen is not None:\n",
        "tests/shell/test_handles.py",
    ),
    Defence(
        "a failure logged as unseen that is about to be awaited",
        "bus/bus.py",
        "        self._loop.call_soon(self._tell_unseen, handle)\n",
        "        self._tell_unseen(handle)\n",
        "tests/shell/test_handles.py",
    ),
    Defence(
        "a release that a cancellation loses",
        "bus/handle.py",
        "        while not future.done():\n            try:\n                await asyncio.wait([future])\n",
        "        if not future.done():\n            try:\n                await asyncio.wait([future])\n",
        "tests/shell/test_endings.py",
    ),
    Defence(
        "motors left to themselves when the event loop ends",
        "bus/bus.py",
        '        self.spawn(self._keep(), "rs485bus keeper")\n',
        "",
        "tests/shell/test_endings.py",
    ),
    Defence(
        "a lost start repeated without looking whether it was taken",
        "devices/conduct.py",
        "                    if await self._took(move, before, target, once):\n                        return\n",
        "                    pass\n",
        "tests/shell/test_exactly_once.py",
    ),
    Defence(
        "a drive that restarted and counts from zero",
        "devices/travel.py",
        "        elif seen is not None and not self._near(seen.position, look.position):",
        "        elif False:",
        "tests/shell/test_exactly_once.py",
    ),
    Defence(
        "going on after a failure that nobody has seen",
        "devices/orders.py",
        "                    self._failed = handle\n",
        "                    self._failed = None\n",
        "tests/shell/test_wrong_input.py",
    ),
    Defence(
        "a broadcast that moves a device that is being stopped",
        "bus/gate.py",
        "return _FOREVER if job.moves and any(station.halt for station in self._hearing(job)) else READY",
        "return READY",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "a broadcast that moves a device that was stopped for safety",
        "bus/gate.py",
        "any(station.locked for station in self._hearing(job))",
        "False",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "a request made at the end of another, answered by bytes that were there before",
        "bus/pump.py",
        "running, self._running = self._running, True",
        "running, self._running = self._running, False",
        "tests/shell/test_chained.py",
    ),
    Defence(
        "a new stop that waits until a lost device is looked for",
        "bus/stopping.py",
        "while now < until and order == self._orders:",
        "while now < until:",
        "tests/bus/test_stops.py",
    ),
    Defence(
        "a second Ctrl-C in the middle of what stops the motors",
        "bus/interrupts.py",
        "signal.signal(signal.SIGINT, self._note)",
        "pass",
        "tests/real/test_interrupts_in_real_time.py",
    ),
    Defence(
        "a move given while the cable is out, made when it is back",
        "devices/axis.py",
        "if not self.bus.connected:",
        "if False:",
        "tests/shell/test_wrong_input.py",
    ),
    Defence(
        "a drive left turning by another program, enabled as it turns",
        "devices/conduct.py",
        "if self._enabled is None and await self._turns():",
        "if False:",
        "tests/shell/test_wrong_input.py",
    ),
    Defence(
        "a turning drive set to zero",
        "devices/conduct.py",
        "if self._running or await self._turns():",
        "if self._running:",
        "tests/shell/test_wrong_input.py",
    ),
    Defence(
        "a motor that goes on after an error that nobody foresaw",
        "devices/orders.py",
        "if not isinstance(error, BusError):",
        "if False:",
        "tests/shell/test_wrong_input.py",
    ),
    Defence(
        "a restart while the port was lost",
        "devices/halting.py",
        "        if self.motion.may_move:\n            self._forget()",
        "        if True:\n            self._forget()",
        "tests/devices/mks/test_restarts.py",
    ),
    Defence(
        "a block around a move, cancelled at its end, that lets it go on",
        "devices/move.py",
        "            except asyncio.CancelledError:\n                self.cancel()\n",
        "            except asyncio.CancelledError:\n",
        "tests/shell/test_handles.py",
    ),
    Defence(
        "a stop on a closed bus that is waited for without end",
        "devices/halting.py",
        "if self.bus.owner.gate.closed:",
        "if False:",
        "tests/shell/test_wrong_input.py",
    ),
    Defence(
        "a watchdog left on because a few writes were lost",
        "bus/guarding.py",
        "internal=True, retries=_RETRIES)",
        "internal=True)",
        "tests/shell/test_endings.py",
    ),
    Defence(
        "a watchdog left on after a trip",
        "bus/guarding.py",
        "return station.rearm is not None or owner.feeding.get(station.address) is not None",
        "return owner.feeding.get(station.address) is not None",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "a watchdog left on that did not say that it was armed",
        "bus/guarding.py",
        "            station.rearm = timeout  # from now on it may be armed, whatever it answers\n",
        "",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "two sets of watchdogs admitted, each as if it were alone",
        "bus/guarding.py",
        "owner.feeding.with_planned() | planned",
        "{watch.address: watch for watch in owner.feeding.all()} | planned",
        "tests/bus/test_feeding.py",
    ),
    Defence(
        "an inner watchdog block that disarms the device of an outer one",
        "bus/watch.py",
        "if owner.stations[device.address].guarded:",
        "if False:",
        "tests/shell/test_endings.py",
    ),
]


def survives(defence: Defence, copy: Path) -> bool:
    """Whether the tests pass without the defence."""
    file = copy / "rs485bus" / defence.file
    source = file.read_text()
    if source.count(defence.code) != 1:
        raise SystemExit(f"{defence.file} has the code against {defence.against!r} {source.count(defence.code)} times")
    file.write_text(source.replace(defence.code, defence.without))
    try:
        command = (sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *defence.test.split())
        return subprocess.run(command, cwd=copy, capture_output=True, timeout=120, check=False).returncode == 0
    except subprocess.TimeoutExpired:
        return False  # it hangs: that is seen, too
    finally:
        file.write_text(source)


def main() -> int:
    wanted = [defence for defence in DEFENCES if all(word in defence.against for word in sys.argv[1:])]
    unseen = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for part in ("rs485bus", "tests"):
            shutil.copytree(ROOT / part, copy / part, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", copy)
        for defence in wanted:
            seen = not survives(defence, copy)
            print("seen  " if seen else "UNSEEN", defence.against, flush=True)
            if not seen:
                unseen.append(defence)
    print(f"{len(wanted) - len(unseen)} of {len(wanted)} defences were noticed to be missing when they were taken out")
    return 1 if unseen else 0


if __name__ == "__main__":
    sys.exit(main())
