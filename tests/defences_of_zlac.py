"""The defences of the ZLAC8015D, for `tests.defences`."""

from __future__ import annotations

from tests.defence import Defence

_TESTS = "tests/devices/zlac/"

ZLAC = [
    Defence(
        "ZLAC: enabling that goes on with an old target",
        "devices/zlac/modes.py",
        "            await self._zero_targets()\n            self.driver.attached.mode = None\n",
        "            self.driver.attached.mode = None\n",
        _TESTS + "test_stopping.py",
    ),
    Defence(
        "ZLAC: a change of mode that goes on with an old target",
        "devices/zlac/modes.py",
        "            await self._neutral(*await self._harmless(mode))\n",
        "",
        _TESTS + "test_wheels.py",
    ),
    Defence(
        "ZLAC: moving after an emergency stop without enabling",
        "devices/zlac/modes.py",
        "self.paused = not emergency and (self.paused or enabled)",
        "self.paused = True",
        _TESTS + "test_stopping.py",
    ),
    Defence(
        "ZLAC: a start of both wheels repeated while they move",
        "devices/zlac/wheel.py",
        "        if any(look.moving for look in looks.values()):\n            return True\n",
        "",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "ZLAC: a start of both wheels repeated after a short move has ended",
        "devices/zlac/wheel.py",
        "        if all(wheels[side]._near(looks[side].position, target) for side, (_, target) in sent.items()):\n"
        "            return True\n",
        "",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "ZLAC: a start of both wheels repeated to a drive that restarted",
        "devices/zlac/wheel.py",
        "            wheels[side]._check_reference(looks[side], before)\n",
        "            pass\n",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "ZLAC: a speed that was lost taken for told",
        "devices/zlac/modes.py",
        "return all([await self.driver.read(twin.of(side)) == value for side, value in wanted.items()])",
        "return True",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "ZLAC: a drive that restarted taken for the one it was",
        "devices/zlac/setup.py",
        "        driver.restarted()  # after power-on",
        "        pass  # after power-on",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "ZLAC: a drive that restarted on its way to zero taken for one that came there",
        "devices/zlac/wheel.py",
        "            if not look.enabled:\n",
        "            if False:\n",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "ZLAC: a fault of one wheel while the other goes on",
        "devices/zlac/hub.py",
        "                self.other._orders.interrupt(fault)\n                self._halt(emergency=True)\n",
        "                pass\n",
        _TESTS + "test_faults.py",
    ),
    Defence(
        "ZLAC: a fault of one wheel that nobody looks at while the other keeps its speed",
        "devices/zlac/zlac.py",
        "if word.either(ShaftState.ALARM) and self._keeps_speed and not self._faulty:",
        "if False:",
        _TESTS + "test_faults.py",
    ),
    Defence(
        "ZLAC: an older start of the wheel that was stopped along with the other",
        "devices/zlac/attached.py",
        "        self.motion.stop()\n        self._quick_stopped(emergency)\n",
        "        self._quick_stopped(emergency)\n",
        _TESTS + "test_stopping.py",
    ),
    Defence(
        "ZLAC: a run bit believed although the position changes",
        "devices/zlac/telemetry.py",
        "        if at - self._since >= (self._contradicted if running else self._quiet):\n",
        "        if not running or at - self._since >= self._contradicted:\n",
        _TESTS + "test_stopping.py " + _TESTS + "test_status.py",
    ),
    Defence(
        "ZLAC: an absolute target beyond what the drive takes",
        "devices/zlac/hub.py",
        "return -r.MAX_ABSOLUTE, r.MAX_ABSOLUTE",
        "return -r.MAX_COUNTS, r.MAX_COUNTS",
        _TESTS + "test_limits.py",
    ),
    Defence(
        "ZLAC: a distance beyond the register",
        "devices/zlac/wheel.py",
        "        if abs(self._to_counts(distance)) > r.MAX_COUNTS:\n",
        "        if False:\n",
        _TESTS + "test_limits.py",
    ),
    Defence(
        "ZLAC: odometry that jumps where a counter wraps",
        "devices/zlac/telemetry.py",
        "return (after - before + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000",
        "return after - before",
        _TESTS + "test_odometry.py",
    ),
    Defence(
        "ZLAC: a vehicle carried away by a drive that restarted",
        "devices/zlac/differential.py",
        "        if max(map(abs, odometry.ways(counts))) > furthest * math.tau * self.wheel_radius:\n",
        "        if False:\n",
        _TESTS + "test_differential.py",
    ),
    Defence(
        "ZLAC: a ramp whose answer was lost taken for written",
        "devices/zlac/driver.py",
        "                self._held.clear()  # whether",
        "                self._held.update(held)  # whether",
        _TESTS + "test_setup.py",
    ),
    Defence(
        "ZLAC: an EEPROM worn out by speeds and targets",
        "devices/zlac/setup.py",
        "        await driver.write(r.SAVE_WRITES, False)\n",
        "        pass\n",
        _TESTS + "test_setup.py",
    ),
]
