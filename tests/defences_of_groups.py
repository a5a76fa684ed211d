"""The defences of groups, for `tests.defences`."""

from __future__ import annotations

from tests.defence import Defence

_BURSTS = "tests/bus/test_bursts.py"
_ARRIVAL = "tests/devices/test_group_arrival.py"
_ENDINGS = "tests/devices/test_group_endings.py"
_ONCE = "tests/devices/test_group_once.py"

GROUPS = [
    Defence(
        "group: a burst that begins before all of it waits",
        "bus/burst.py",
        "        if self._missing:\n",
        "        if False:\n",
        _BURSTS,
    ),
    Defence(
        "group: frames of a burst sent though one before them was not",
        "bus/starts.py",
        "            job.slot.burst.break_off()\n",
        "            pass\n",
        _BURSTS,
    ),
    Defence(
        "group: a burst that starts some, and others only when a late reply has come",
        "bus/starts.py",
        "            until = max(until, self._gate.wait(job, now))\n",
        "",
        _BURSTS,
    ),
    Defence(
        "group: a burst longer than watchdogs can wait for",
        "bus/starts.py",
        "if takes_all > self._feeding.slack",
        "if False",
        _BURSTS,
    ),
    Defence(
        "group: a burst without answers that keeps watchdogs from being fed",
        "bus/owner.py",
        "if self.starts and (watch is None or not self.starts.gives_way(self.now)):",
        "if self.starts:",
        _BURSTS,
    ),
    Defence(
        "group: bursts on two pairs at two times",
        "bus/burst.py",
        "if not all(part.is_free(now) for part in self._parts):",
        "if False:",
        _ARRIVAL,
    ),
    Defence(
        "group: who starts later arrives later",
        "devices/formation.py",
        "fitting(axis, turns, seconds - late[axis.attached], highest)",
        "fitting(axis, turns, seconds, highest)",
        _ARRIVAL,
    ),
    Defence(
        "group: an axis so slow that it seems to stand taken for one that failed",
        "devices/travel.py",
        "if look is None or self._keeps_up(move, look):",
        "if look is None:",
        _ARRIVAL,
    ),
    Defence(
        "group: an axis that nobody looks at before it should arrive",
        "devices/travel.py",
        "                    answers = await self._watch(move)\n",
        "                    await self._stands.wait()\n",
        _ENDINGS,
    ),
    Defence(
        "group: others that move on though one does not answer",
        "devices/travel.py",
        "                    return False\n        return True\n",
        "                    return True\n        return True\n",
        _ENDINGS,
    ),
    Defence(
        "group: others that move on while it is found out why one failed",
        "devices/halting.py",
        "        self._stumble()\n",
        "",
        _ENDINGS,
    ),
    Defence(
        "group: others that move on when one has failed",
        "devices/formation.py",
        "            axis.stop_if_moving()\n",
        "            pass\n",
        _ENDINGS,
    ),
    Defence(
        "group: telling of a failure before the others are told to stop",
        "devices/formation.py",
        "        if error is None or self._unstopped:\n",
        "        if error is None:\n",
        _ENDINGS,
    ),
    Defence(
        "group: others that wait for ever for one that never comes",
        "devices/joint.py",
        "            self._company.broken(self.who, error)\n",
        "            super().fail(error)\n",
        _ENDINGS,
    ),
    Defence(
        "group: one that leaves a meeting and takes the others along",
        "devices/meeting.py",
        "await asyncio.shield(outcome)",
        "await outcome",
        "tests/devices/test_meeting.py",
    ),
    Defence(
        "group: an axis that starts alone because what is written ahead was lost",
        "devices/conduct.py",
        "            await self._surely_write_ahead(target, pace)\n",
        "            await self._write_ahead(target, pace)\n",
        _ONCE,
    ),
    Defence(
        "group: an axis that goes on to its next command while another may still fail",
        "devices/travel.py",
        "        await move.ended()\n",
        "",
        _ENDINGS,
    ),
    Defence(
        "group: a lost start repeated without looking whether it was taken",
        "devices/conduct.py",
        "                    if await self._took(move, before, target, once):\n                        return\n",
        "                    pass\n",
        _ONCE,
    ),
]
