"""Setting an MKS drive up. Source: MKS RTU V1.0.9, the section named at each method."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rs485bus.arguments import choice, flag, instance, positive
from rs485bus.bus.handle import Handle
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import current
from rs485bus.devices.mks.homing import Homing
from rs485bus.devices.mks.settings import SETTINGS, Gains, MksProfile, PositionProtection, PulseDivider, plain
from rs485bus.devices.mks.values import EnableLevel, HoldingCurrent, ParameterDirection, WorkMode
from rs485bus.motion.axis import Axis
from rs485bus.motion.plan import Ask, Plan


class MksSetup(Axis):
    """Settings. Each joins the queue and returns a handle, is kept by the drive when it is switched off, and wears its
    flash (see `Cost`); `set_current(..., save=False)` is the exception.

    Every method raises `LimitExceeded` for a value out of its range, before anything is queued. The handle raises
    `NotStanding` where the motor turns and must not, and what a request can end in (`DeviceRefused`, `NoReply`, ...).
    """

    _mks: MksDrive

    @property
    def acknowledged(self) -> MksProfile:
        """The settings that the drive has acknowledged to this facade. They cannot be read back."""
        return self._mks.acknowledged

    def write_profile(self, profile: MksProfile) -> Handle[MksProfile]:
        """Write all settings of a profile, in its order. The handle gives what the drive has acknowledged so far.

        It fails with the first setting that is not acknowledged; `profile.differences(axis.acknowledged)` tells then
        what is missing.
        """
        self.check_profile(profile)
        values = {name: plain(name, value) for name, value in profile.values().items()}

        def plan() -> Plan[MksProfile]:
            for name, value in values.items():
                yield from self._mks.write(name, value)
            return self._mks.acknowledged

        return self._order_plan("profile", plan)

    def check_profile(self, profile: MksProfile) -> None:
        """Refuse a profile of which a value is out of its range. Raises `LimitExceeded`."""
        instance(f"{self.name}: profile", profile, MksProfile, "MksProfile(microsteps=16)")
        for name, value in profile.values().items():
            self._check(name, value)

    def set_mode(self, mode: WorkMode) -> Handle[None]:
        """Who commands the motor, and how it is driven (3.2.2). The motor must stand. The bus moves the SR modes."""
        return self._set("mode", choice("work mode", mode, WorkMode))

    def set_current(self, milliamperes: int, *, save: bool = True) -> Handle[None]:
        """The working current: 0..3000 mA, of a 57D 0..5200 mA (3.2.3).

        Args:
            milliamperes: the current.
            save: whether the drive keeps it. Without, it holds until a restart and spares the flash.
        """
        if flag("save", save):
            return self._set("current", milliamperes)
        request = current(self._mks.address, self._mks.model, milliamperes, save=False)

        def plan() -> Plan[None]:
            yield Ask(request)

        return self._order_plan(f"current {milliamperes} mA", plan)

    def set_holding_current(self, part: HoldingCurrent) -> Handle[None]:
        """The current at a standstill: 10 to 90 % of the working current (3.2.4)."""
        return self._set("holding_current", part)

    def set_microsteps(self, microsteps: int) -> Handle[None]:
        """Microsteps to a full step: 1..255 (3.2.5). The motor must stand. Moves behind it reckon with them."""
        return self._set("microsteps", microsteps)

    def set_enable_level(self, level: EnableLevel) -> Handle[None]:
        """When the En input enables the motor (3.2.6). In the SR modes `enable` does (7.2.2)."""
        return self._set("enable_level", level)

    def set_pulse_direction(self, direction: ParameterDirection) -> Handle[None]:
        """Which way pulses turn the motor (3.2.7). It has no meaning for moves over the bus."""
        return self._set("pulse_direction", direction)

    def set_screen_off(self, on: bool) -> Handle[None]:
        """Whether the screen goes dark by itself (3.2.8)."""
        return self._set("screen_off", on)

    def set_interpolation(self, on: bool) -> Handle[None]:
        """Whether the drive interpolates to 256 microsteps inside (3.2.9)."""
        return self._set("interpolation", on)

    def set_key_lock(self, on: bool) -> Handle[None]:
        """Whether its keys are locked (3.2.13)."""
        return self._set("key_lock", on)

    def set_vfoc_gains(self, gains: Gains) -> Handle[None]:
        """The gains in the vFOC modes, each 0..1024 (3.3.1). The motor must stand."""
        return self._set("vfoc_gains", gains)

    def set_close_gains(self, gains: Gains) -> Handle[None]:
        """The gains in the CLOSE modes, each 0..1024 (3.3.2). The motor must stand."""
        return self._set("close_gains", gains)

    def set_overcurrent_protection(self, on: bool) -> Handle[None]:
        """Whether too much current lets go of the shaft (3.4.1). Without, a stalled motor goes on pushing."""
        return self._set("overcurrent_protection", on)

    def set_position_protection(self, protection: PositionProtection) -> Handle[None]:
        """Whether a position error lets go of the shaft: 0..2.34 turns for 0..983.025 s (3.4.2)."""
        return self._set("position_protection", protection)

    def set_pulse_divider(self, divider: PulseDivider) -> Handle[None]:
        """Toggle OUT_2 every 100..4294967295 pulses; less turns it off (4.3). 57D only, or raises `NotSupported`."""
        return self._set("pulse_divider", divider)

    def set_limit_remap(self, on: bool) -> Handle[None]:
        """Whether the limit switches are on En and Dir instead of IN_1 and IN_2 (5.3.1). The motor must stand.

        Without, only a 57D has a right limit (1.2). Limits count from the next homing on.
        """
        return self._set("limit_remap", on)

    def set_homing(self, homing: Homing) -> Handle[None]:
        """What `home()` will do (5.3.2, 5.3.3, 5.3.4). The motor must stand. Limits count from the next homing on.

        `SingleTurnHoming` may take 1.6 s, and is refused while a watchdog on the bus is armed.
        """
        return self._set("homing", homing)

    # Inside

    def _set(self, name: str, value: Any) -> Handle[None]:
        self._check(name, value)
        known = plain(name, value)
        return self._order_plan(SETTINGS[name].title, lambda: self._mks.write(name, known))

    def _check(self, name: str, value: Any) -> None:
        """Raise what is out of range before it is queued."""
        SETTINGS[name].frames(self._mks.address, self._mks.model, value)

    def _order_restart(self, what: str, plan: Callable[[MksDrive, float], Plan[None]], timeout: float) -> Handle[None]:
        """Queue what has the drive restart, and the wait until it is back: so many seconds."""
        by = positive(f"{self.name}: timeout", timeout)
        return self._order_plan(what, lambda: plan(self._mks, by))
