"""What a drive raises alarms for, and what to do about them. Source: TL-R manual, 3.6.

PA_005 lists the codes 1 to 3 (3.5.1), the table of 3.6 five alarms: the last two are taken to follow in its order.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm."""

    code: int
    """What PA_005 reads; also how often its light blinks in a row."""
    name: str
    remedy: str
    power_cycle: bool
    """Whether it ends only when the drive is switched off and on; otherwise `clear_alarm()` ends it."""

    def __str__(self) -> str:
        then = "then switch the drive off and on" if self.power_cycle else "then clear_alarm() and enable()"
        return f"alarm {self.code}, {self.name}: {self.remedy}; {then}"


ALARMS = {
    alarm.code: alarm
    for alarm in (
        Alarm(
            1,
            "overcurrent",
            "look for a short circuit in the motor's wires and measure both windings; if they are sound, the drive is "
            "defective",
            power_cycle=True,
        ),
        Alarm(
            2,
            "overvoltage",
            "measure the supply, and take one of a lower voltage; if it is right, the drive is defective",
            power_cycle=True,
        ),
        Alarm(
            3,
            "undervoltage",
            "measure the supply, and take one that holds its voltage; if it does, the drive is defective",
            power_cycle=True,
        ),
        Alarm(4, "memory error", "the drive is defective if it comes again", power_cycle=False),
        Alarm(
            5,
            "position error",
            "check the order of the motor's wires, that none is broken, and the encoder's cable; free the load, or "
            "move it slower",
            power_cycle=False,
        ),
    )
}
"""By code."""


def alarm_of(code: int) -> Alarm | None:
    """The alarm that PA_005 reads; None for 0. A code that the manual does not name is an alarm all the same."""
    if code == 0:
        return None
    return ALARMS.get(code) or Alarm(code, "not described", "ask the manufacturer", power_cycle=False)
