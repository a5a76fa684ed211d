"""The defences of TL-R steppers, for `tests.defences`."""

from __future__ import annotations

from tests.defence import Defence

_TESTS = "tests/devices/tlr/"

TLR = [
    Defence(
        "TL-R: a start before the target was read back",
        "devices/tlr/link.py",
        "        if there != wanted:\n            raise DeviceRefused(",
        "        if False:\n            raise DeviceRefused(",
        _TESTS + "test_position.py",
    ),
    Defence(
        "TL-R: firmware that keeps a part of a block",
        "devices/tlr/link.py",
        "        if there != wanted and len(wanted) > 1:\n",
        "        if False:\n",
        _TESTS + "test_position.py",
    ),
    Defence(
        "TL-R: a trigger that does not rise",
        "devices/tlr/drive.py",
        "        if self.link.clear_trigger:\n            await self.link.control(ControlWord.NONE)\n",
        "",
        _TESTS + "test_position.py",
    ),
    Defence(
        "TL-R: a trigger that is taken and does nothing",
        "devices/tlr/drive.py",
        "        await self._see_it_start(target)\n",
        "",
        _TESTS + "test_position.py",
    ),
    Defence(
        "TL-R: a motor that starts after it was said not to have",
        "devices/tlr/drive.py",
        "        # It must not start after all once this has been said.\n        await self._stand_still()\n",
        "",
        _TESTS + "test_position.py",
    ),
    Defence(
        "TL-R: a trigger repeated although the first one was taken",
        "devices/tlr/link.py",
        "        await self._ask(control(self._address, word), repeat=repeat, moves=True, slot=slot)\n",
        "        await self._ask(control(self._address, word), moves=True, slot=slot)\n",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "TL-R: a drive that restarted taken for the one it was",
        "devices/tlr/knowledge.py",
        "        if restarted:\n            self._restarted(",
        "        if False:\n            self._restarted(",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "TL-R: enabling that hides a restart",
        "devices/tlr/drive.py",
        "        if self._witness.denies(there):\n",
        "        if False:\n",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "TL-R: a restart that cannot be told after saving",
        "devices/tlr/settings.py",
        "            await self._put_nothing(unlike=1)\n",
        "",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "TL-R: a target whose answer was lost taken for a restart",
        "devices/tlr/witness.py",
        "[held | {value} for held, value in zip(self._may_hold, values, strict=True)]",
        "[held for held in self._may_hold]",
        _TESTS + "test_exactly_once.py",
    ),
    Defence(
        "TL-R: a stop whose bit is set already and does not rise",
        "devices/tlr/attached.py",
        "        if not held:\n",
        "        if True:\n",
        _TESTS + "test_stops.py",
    ),
    Defence(
        "TL-R: a jog for a time that goes on when the host is gone",
        "devices/tlr/drive.py",
        "        if duration is None or rpm == 0:\n",
        "        if True:\n",
        _TESTS + "test_stops.py",
    ),
    Defence(
        "TL-R: status bit 4 relied on",
        "devices/tlr/knowledge.py",
        "enabled = StatusWord.ENABLED in report.status if self.enabled_bit else self._energised is True",
        "enabled = StatusWord.ENABLED in report.status",
        _TESTS + "test_position.py",
    ),
    Defence(
        "TL-R: a homing that is begun a second time",
        "devices/tlr/homing.py",
        "                if self._differs(look, before):\n                    return\n",
        "",
        _TESTS + "test_homing.py",
    ),
    Defence(
        "TL-R: a homing taken for done because the drive was homed before",
        "devices/tlr/homing.py",
        "if started and _homed(look) and (fresh or long or mode is HomingMode.HERE):",
        "if _homed(look):",
        _TESTS + "test_homing.py",
    ),
    Defence(
        "TL-R: a homing by a switch that no input has",
        "devices/tlr/homing.py",
        "if needed is not None and needed not in await self.link.read_words(r.ALL_INPUT_FUNCTIONS):",
        "if False:",
        _TESTS + "test_homing.py",
    ),
    Defence(
        "TL-R: moves of a drive that reports a fault",
        "devices/tlr/knowledge.py",
        "        if isinstance(look, TlrLook):\n"
        "            self._check_fault(look.report)\n"
        "        self._gone = False\n",
        "        self._gone = False\n",
        _TESTS + "test_alarms.py",
    ),
    Defence(
        "TL-R: a station that is written again although it may have been taken",
        "devices/tlr/link.py",
        "words(register.encode(value))), repeat=Repeat.NEVER)",
        "words(register.encode(value))))",
        _TESTS + "test_settings.py",
    ),
]
