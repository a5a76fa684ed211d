"""What an MKS drive shows on its screen when something is wrong, and what to do then. Source: MKS RTU V1.0.9, 10.2.

Nothing of it can be read over the bus but the stall (0x3E), so messages name what the screen may show.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Alarm:
    """One message of the screen."""

    shown: str
    remedy: str


NOT_CALIBRATED: Final = Alarm("Not Cal", "it was never calibrated: calibrate() it, with nothing on its shaft")
CALIBRATION_FAILED: Final = Alarm(
    "Reverse Lookup Error!", "its calibration failed: see that magnet and shaft are right and free, and repeat it"
)
NO_MAGNET: Final = Alarm("Magnet Loss!", "its encoder finds no magnet: put one on the end of the shaft")
MAGNET_NEAR: Final = Alarm("Magnet Strong!", "the magnet is too near to the encoder: 0.5 to 3 mm are right (10.1)")
MAGNET_FAR: Final = Alarm("Magnet Weak!", "the magnet is too far from the encoder: 0.5 to 3 mm are right (10.1)")
ENCODER: Final = Alarm("Encoder Error!", "its encoder reads nonsense: see that magnet and shaft sit right")
CURRENT_OFFSET: Final = Alarm("Offset Current Error!", "the reference voltage of its current measurement is wrong")
PHASES: Final = Alarm(
    "Phase Line Error!",
    "the motor's wires are in the wrong order, or the supply is too weak: 24 V and 1 A, or 12 V and 2 A (10.1)",
)
STALLED: Final = Alarm(
    "Wrong Protect!",
    "its stall protection let go of the shaft: free that, give it more current or less acceleration, then "
    "release_stall() and enable()",
)
HOMING: Final = Alarm("Coming Back to Origin..", "it is homing: wait, or stop() it")
RESTART_DUE: Final = Alarm("Reboot Again", "it has to be started anew: restart() it, or switch it off and on")
KEY_DUE: Final = Alarm("Press Next Key To Fixed", "hold its Next key until it starts anew")
LOW_VOLTAGE: Final = Alarm("Low Voltage Error!", "its supply is too low: it needs 12 to 24 V (10.1)")

ALARMS: Final = (
    NOT_CALIBRATED,
    CALIBRATION_FAILED,
    NO_MAGNET,
    MAGNET_NEAR,
    MAGNET_FAR,
    ENCODER,
    CURRENT_OFFSET,
    PHASES,
    STALLED,
    HOMING,
    RESTART_DUE,
    KEY_DUE,
    LOW_VOLTAGE,
)
"""All of them, in the order of the manual."""
KEEP_IT_OFF: Final = (NOT_CALIBRATED, PHASES, LOW_VOLTAGE, ENCODER, CURRENT_OFFSET, STALLED)
"""Why a motor may not be enabled."""
AFTER_RESTART: Final = (LOW_VOLTAGE, PHASES, RESTART_DUE, KEY_DUE)
"""Why a drive may not come back."""
AFTER_CALIBRATION: Final = (CALIBRATION_FAILED, NO_MAGNET, MAGNET_NEAR, MAGNET_FAR, ENCODER, PHASES)
"""Why a calibration may fail."""


def alarm(shown: str) -> Alarm:
    """The alarm that a screen shows; the beginning of its text is enough. Raises `KeyError` for none of them.

    A stall shows as "Wrong..." where the current, and as "Wrong2..." where the position error gave it away (3.4).
    """
    text = shown.strip().rstrip(".!").lower()
    if text in ("wrong", "wrong2"):
        return STALLED
    found = [each for each in ALARMS if text and each.shown.lower().startswith(text)]
    if len(found) != 1:
        raise KeyError(shown)
    return found[0]


def hints(alarms: Iterable[Alarm]) -> str:
    """A sentence that says what the screen may show, and what to do then."""
    shown = "; ".join(f'"{each.shown}": {each.remedy}' for each in alarms)
    return f"Its screen may say why. {shown}."
