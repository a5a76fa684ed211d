"""The defences of MKS SERVO drives, for `tests.defences`."""

from __future__ import annotations

from tests.defence import Defence

_TESTS = "tests/devices/mks/"

MKS = [
    Defence(
        "MKS: a move repeated to a drive that restarted at its home",
        "devices/mks/drive.py",
        "        if not took and target is not None:\n            await self._check_zero(before)\n",
        "",
        _TESTS + "test_restarts.py",
    ),
    Defence(
        "MKS: a move of a drive that restarted while it stood at its home",
        "devices/mks/drive.py",
        "        if standing and look is not seen:\n            await self._check_zero(look)\n",
        "",
        _TESTS + "test_restarts.py",
    ),
    Defence(
        "MKS: enabling that hides a restart at home",
        "devices/mks/drive.py",
        "            await self._has_forgotten_zero(self._seen)\n",
        "            pass\n",
        _TESTS + "test_restarts.py",
    ),
    Defence(
        "MKS: a drive that restarted on its way to zero taken for one that came there",
        "devices/mks/moves.py",
        "        await self._check_came_to_zero(look)\n",
        "",
        _TESTS + "test_restarts.py",
    ),
    Defence(
        "MKS: a drive that restarted taken for one that arrived at once",
        "devices/travel.py",
        "if look.at - move.started_at < (move.eta - move.started_at) / 2 - FRESH:",
        "if False:",
        _TESTS + "test_moves.py",
    ),
    Defence(
        "MKS: a relative move too short to be seen repeated blindly",
        "devices/conduct.py",
        "            if once and self._near(before.position, target):\n",
        "            if False:\n",
        _TESTS + "test_moves.py",
    ),
    Defence(
        "MKS: a relative move repeated before the first one can have started",
        "devices/conduct.py",
        "        await anyio.sleep(max(0.0, self.attached.may_start_until(self.motion) - self.bus.now()))\n",
        "",
        _TESTS + "test_moves.py",
    ),
    Defence(
        "MKS: another speed that was lost taken for reached by a motor that turns anyway",
        "devices/mks/drive.py",
        "            target is None\n            and before.moving\n",
        "            False\n",
        _TESTS + "test_restarts.py",
    ),
    Defence(
        "MKS: a motor left turning at a speed that nobody knows",
        "devices/mks/drive.py",
        "            if before.moving and not self._blocked:\n",
        "            if False:\n",
        _TESTS + "test_restarts.py",
    ),
    Defence(
        "MKS: a change of target that sets a drive in motion that had stopped",
        "devices/retarget.py",
        "        if not look.moving:\n",
        "        if False:\n",
        _TESTS + "test_retargeting.py",
    ),
    Defence(
        "MKS: a change of target repeated to a drive that restarted",
        "devices/retarget.py",
        "                if not await self._still_turns():\n",
        "                if False:\n",
        _TESTS + "test_retargeting.py",
    ),
    Defence(
        "MKS: a homing that is begun a second time",
        "devices/mks/origin.py",
        "                if look.moving or now != homed:\n",
        "                if False:\n",
        _TESTS + "test_homing.py",
    ),
    Defence(
        "MKS: a homing taken for done because another kind was",
        "devices/mks/origin.py",
        "found = Homed.DONE in homed if half is None else homed[half] is Homed.DONE",
        "found = Homed.DONE in homed",
        _TESTS + "test_faults.py",
    ),
    Defence(
        "MKS: a homing that never finds its switch and is not stopped",
        "devices/mks/origin.py",
        "                self._begin_stop(emergency=True)\n",
        "",
        _TESTS + "test_faults.py",
    ),
    Defence(
        "MKS: a stalled motor that goes on pushing",
        "devices/mks/drive.py",
        "            if not (await self._halted(self._halt(emergency=True))).standing:\n"
        "                return self._unconfirmed()\n",
        "",
        _TESTS + "test_faults.py",
    ),
    Defence(
        "MKS: a refused move taken for accepted",
        "devices/mks/frames.py",
        "block.encode(*values), hidden_refusal=True)",
        "block.encode(*values), hidden_refusal=False)",
        _TESTS + "test_faults.py",
    ),
    Defence(
        "MKS: a status that is stuck taken for a motor that turns",
        "devices/mks/drive.py",
        "            moving = not await self._stands_after_all(at, position)\n",
        "            pass\n",
        _TESTS + "test_faults.py",
    ),
    Defence(
        "MKS: speeds that are wrong at other microsteps",
        "devices/mks/drive.py",
        "return 1.0 if self.microsteps in _CALIBRATED else self.microsteps / 16",
        "return 1.0",
        _TESTS + "test_moves.py",
    ),
    Defence(
        "MKS: microsteps of which nobody knows whether they were taken",
        "devices/mks/setup.py",
        "            self._unsure |= {name}\n",
        "            pass\n",
        _TESTS + "test_settings.py",
    ),
    Defence(
        "MKS: a target beyond the register",
        "devices/axis.py",
        "        if not math.isfinite(position) or not lowest <= (counts := self._to_counts(position)) <= highest:\n",
        "        counts = self._to_counts(position)\n        if False:\n",
        _TESTS + "test_moves.py",
    ),
    Defence(
        "MKS: a current beyond the model",
        "devices/mks/frames.py",
        "    if not 0 <= real(name, milliamperes) <= model.max_current:\n",
        "    if False:\n",
        _TESTS + "test_settings.py",
    ),
    Defence(
        "MKS: a drive that is sent away while a watchdog is armed",
        "devices/mks/attached.py",
        "and request.register in _DISRUPTING",
        "and False",
        _TESTS + "test_settings.py",
    ),
]
